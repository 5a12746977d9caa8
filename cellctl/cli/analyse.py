"""`cellctl analyse`: how alike the errors of a robot are at nearby joints, and at nearby positions."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from cellctl.analysis import similarity
from cellctl.cli import arguments
from cellctl.cli.arguments import Unwritten, refuse_outputs, shown_name, write_json
from cellctl.cli.fit_progress import shown_progress
from cellctl.files import load_yaml
from cellctl.files.kinds import ROBOT
from cellctl.formats import DataSet, Measurements, ModelFile, RobotFile
from cellctl.formats.similarity_report import (
    p_text,
    result_sentences,
    robot_errors,
    rows_with_positions,
    similarity_report,
)
from cellctl.operations.setup_refusals import SetupFiles, refuse_setup_errors
from cellctl.report.similarity import write_similarity_page

NO_CHECK = "--no-check skips this check: the errors analysed are then those of the wrong set-up"


def analyse(
    robot: arguments.Robot,
    data: Annotated[Path, typer.Argument(help="Data set with measured positions, CSV (docs/reference/data-sets.md).")],
    model: Annotated[Path | None, typer.Option(help="Model file: analyse what this model leaves.")] = None,
    rows: Annotated[int, typer.Option(min=20, max=1000, help="Use a random sample of so many rows at most.")] = 300,
    permutations: Annotated[int, typer.Option(min=99, max=99_999, help="Permutations of the Mantel test.")] = 999,
    check: Annotated[bool, typer.Option(help="Check for set-up errors first: units, signs, order of rows.")] = True,
    seed: Annotated[int, typer.Option(min=0, help="Seed of sample and permutations.")] = 0,
    page: Annotated[Path | None, typer.Option("--report", help="Write an HTML report to this file.")] = None,
    json_: arguments.Json = None,
) -> None:
    """Analyse the similarity of a robot's errors.

    Are errors alike where the joints are close (configuration space), or where the positions are (Cartesian space)?
    Correlations with a Mantel test, and semivariograms overall and for each joint.

    Example: cellctl analyse ur10 ur10.csv --report similarity.html
    """
    refuse_outputs({"--report": page, "--json": json_}, [robot, data, model])

    measured, identified = _measured(robot, DataSet.load(data), check), ModelFile.load(model) if model else None
    errors = robot_errors(measured, identified, str(model), rows, seed)
    found = similarity(errors.found, permutations, seed)
    report = similarity_report(errors, found, seed)
    unwritten = Unwritten()
    if page:
        sources = {
            "robot file": shown_name(robot),
            "data set": shown_name(data),
            "model": shown_name(model) if model else "nominal",
        }
        with unwritten.noted():
            write_similarity_page(page, found, report, measured.robot.name, sources)
    with unwritten.noted():
        write_json(report, json_)
    if json_ != "-":
        typer.echo(_words(report))
    for row in report["rejected"][:20]:
        typer.echo(f"line {row['line']}: not used: {row['reason']}", err=True)
    unwritten.refuse()


def _measured(robot: Path, data: Any, check: bool) -> Measurements:
    """The rows with positions. Raises InputError for set-up errors, if these are to be checked."""
    document = load_yaml(robot, ROBOT)
    measured = rows_with_positions(RobotFile.from_document(document), data)
    if check:
        with shown_progress("check") as progress:
            refuse_setup_errors(measured, SetupFiles(document, Path(data.file)), NO_CHECK, progress)
    return measured


def _words(report: dict[str, Any]) -> str:
    """The figures as text: correlations, semivariogram models, and the result last."""
    error = report["error"]
    lines = [
        f"{report['postures']} postures, {report['pairs']} pairs; error mean {error['mean']:.3f}, "
        f"RMS {error['rms']:.3f}, max {error['max']:.3f} mm",
        "",
        "De of   with   Pearson r   Mantel p   95 % of permuted r",
    ]
    for part, spaces in report["correlation"].items():
        lines += [
            f"{part:<7} {space:<6} {_fixed(each['r']):>9}   {p_text(each['p']):>8}   "
            f"{_fixed(each['low_95'])} … {_fixed(each['high_95'])}"
            for space, each in spaces.items()
        ]
    lines += ["", "semivariogram over   component   nugget    sill   range (standardised)"]
    for name, each in report["semivariogram"].items():
        lines.append(_model_words("all joints", name, each["model"]))
        lines += [_model_words(joint, name, one["model"]) for joint, one in report["by_joint"][name].items()]
    return "\n".join([*lines, "", *result_sentences(report)])


def _model_words(what: str, name: str, model: dict[str, Any] | None) -> str:
    if model is None:
        return f"{what:<20} {name:<9}   too few bins with pairs"
    return f"{what:<20} {name:<9} {_fixed(model['nugget']):>8} {_fixed(model['sill']):>7} {_fixed(model['range']):>7}"


def _fixed(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"
