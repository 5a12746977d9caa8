"""`cellctl fit` and `predict`: a model from robot file and data set, judged on held-out rows, and its predictions."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cellctl.calibration.verdict.comparison import ComparedFits, interval
from cellctl.cli import arguments
from cellctl.cli.arguments import Unwritten, refuse_json_on_stdout, refuse_outputs, shown_name, to_stdout, write_json
from cellctl.cli.exit_codes import SHOWN, Exit
from cellctl.cli.fit_progress import shown_progress
from cellctl.files import InputError, write_atomically
from cellctl.formats import DataSet, ModelFile
from cellctl.operations.fit_options import Asked, Judging, option
from cellctl.operations.fitting import FitInput, compare_fits, fit_rows
from cellctl.operations.predicting import predict_rows

if TYPE_CHECKING:
    from rich.console import Console

_COMPARED = {
    "nominal": "nominal",
    "nominal_with_tool": "nominal with the tool registered",
    "prior": "prior model",
    "test": "identified",
}
_WIDTH = 80
_WIDE = 120
_CAUSES = 5
_LETTERS = 160


def show(report: dict[str, Any]) -> None:
    """The figures as a table, unobservable parameters, mastering offsets, and the verdict as the last line."""
    from rich.console import Console  # only for people: 0.1 s

    console = Console(highlight=False, soft_wrap=True)
    console.width = max(console.width, _WIDTH)  # a narrow terminal may fold a line, but not truncate a figure
    _figures(console, report)
    for words in (*_model(report), *_steps(report), *_unseen(report), *_far(report), *_mastering(report)):
        console.print(words, markup=False)
    console.print(report["sentence"], markup=False)


def name_rows(report: dict[str, Any]) -> None:
    """Every row that was not used, and held-out outliers, on stderr, by line; the JSON has them all."""
    named = [f"line {row['line']}: not used: {row['reason']}" for row in [*report["rejected"], *report["outliers"]]]
    named += [f"line {row['line']}: {row['reason']}" for row in report["test_outliers"]]
    for words in named[:SHOWN]:
        typer.echo(words, err=True)
    if len(named) > SHOWN:
        typer.echo(f"… and {len(named) - SHOWN} more such rows (--json names them all)", err=True)


def _figures(console: Console, report: dict[str, Any]) -> None:
    from rich.table import Table  # only for people: 0.1 s

    table = Table("distances, mm", box=None, pad_edge=False)
    for column in ("mean", "RMS", "max"):
        table.add_column(column, justify="right")
    compared = {key: name for key, name in _COMPARED.items() if report[key]}
    for key, name in compared.items():  # without held-out rows no row supports them
        table.add_row(f"held out, {name}", *(_cells(report[key]) if report["n_test"] else ["–"] * 3))
    table.add_row("rows of the fit", *_cells(report["fit"]))
    for label, figures in report["by"].items():
        for key, name in compared.items():
            table.add_row(f"  {label}, {name}", *_cells(figures[key]))
    console.print(table)


def _cells(figures: dict[str, float]) -> list[str]:
    return [f"{figures[figure]:.3f}" for figure in ("mean", "rms", "max")]


def _model(report: dict[str, Any]) -> Iterator[str]:
    seen = f"{report['rank']} of {report['n_parameters']} parameter combinations are observable"
    yield f"Model {report['model']}; {seen}; {report['n_fit']} rows to fit, {report['n_test']} held out."
    if report["predicted_volumetric_rms"] is not None:
        sure = f"{report['predicted_volumetric_rms']:.3f} mm (1 σ, 3-D, rigid motion removed)"
        wider = f"; 95 % of places within {report['radius_95']:.2f} σ" if report["model_error_scale"] > 1.0 else ""
        yield f"Predicted over {report['predicted_over']}: {sure}{wider}."
    if report["prior"] and not report["informed"]:
        yield "The measured region is still that of the prior model: these rows determined places, not the robot."
    if not report["converged"]:
        yield f"Not converged: {report['ended']}."


def _steps(report: dict[str, Any]) -> Iterator[str]:
    """The models that were tried, each with its cross-validation error on rows of the fit."""
    for step in report["ladder"]:
        kept = "kept" if step["kept"] else "left out"
        gain = (
            f" (gain {step['gain_mm']:.2g} ± {step['standard_error_mm']:.2g} mm)" if step["standard_error_mm"] else ""
        )
        yield f"  {step['model']}: {kept}: {step['error_mm']:.3f} mm in cross-validation{gain}"


def _unseen(report: dict[str, Any]) -> Iterator[str]:
    """The reason, then the parameters: a line for each reason."""
    causes = report["unseen"]
    if causes:
        yield "Not observable with these rows:"
    for cause in causes[:_CAUSES]:
        yield f"  {': '.join([cause['cause'], *_shortly(cause['short'])])}"
    if len(causes) > _CAUSES:
        yield f"  and for {len(causes) - _CAUSES} more reasons (--json names them all)"


def _shortly(phrases: list[str]) -> list[str]:
    """The phrases that fit in one or two lines, at least the first; empty without phrases."""
    ends = [sum(len(phrase) + 2 for phrase in phrases[: count + 1]) for count in range(len(phrases))]
    count = max(sum(end <= _LETTERS for end in ends), 1)
    more = [f"and {len(phrases) - count} more"] if len(phrases) > count else []
    return ["; ".join([*phrases[:count], *more])] if phrases else []


def _far(report: dict[str, Any]) -> Iterator[str]:
    for row in report["wide"]:
        turns = row["unit"] == "rad"
        value, sigma, before = (_shown(row[key], turns) for key in ("value", "sigma", "tolerance"))
        unit = "°" if turns else f" {row['unit']}" if row["unit"] != "1" else ""
        yield f"  far from the robot file: {row['name']} {value}{unit} (1 σ {sigma}, expected within {before})"


def _shown(value: float, turns: bool) -> str:
    return f"{value * (57.29577951308232 if turns else 1.0):.4g}"


def _mastering(report: dict[str, Any]) -> Iterator[str]:
    if report["mastering"]:
        yield "Mastering: add to the controller's readings"
    for row in report["mastering"]:
        if "offset_mm" in row:
            yield f"  {row['joint']}  {row['offset_mm']:+.4f} mm  (1 σ {row['sigma_mm']:.4f} mm)"
        else:
            yield f"  {row['joint']}  {row['offset_deg']:+.4f}°  (1 σ {row['sigma_deg']:.4f}°)"


def show_compared(found: ComparedFits) -> None:
    """The models as a table, and which of them leaves the least as the last line."""
    from rich.console import Console  # only for people: 0.1 s
    from rich.table import Table  # only for people: 0.1 s

    table = Table("held-out distances, mm", box=None, pad_edge=False)
    for column in ("mean", "RMS", "max", "in 95 %", "σ stated/found", "mean less than first, 95 %", "s"):
        table.add_column(column, justify="right")
    table.add_row("nominal", *_cells(asdict(found.nominal)), *[""] * 4)
    for each, took in zip(found.models, found.seconds, strict=True):
        less = interval(each.less) if each.less else ""
        sigma = ["none", ""]
        if each.coverage_95 is not None and each.stated_over_found is not None:
            sigma = [f"{100.0 * each.coverage_95:.0f} %", f"{each.stated_over_found:.2f}"]
        table.add_row(each.choice, *_cells(asdict(each.test)), *sigma, less, f"{took:.1f}")
    console = Console(highlight=False, soft_wrap=True)
    console.width = max(console.width, _WIDE)
    console.print(table)
    console.print(found.sentence, markup=False)


def fit(
    robot: arguments.FittedRobot,
    data: Annotated[Path, typer.Argument(help="Data set, CSV (docs/reference/data-sets.md).")],
    measure: Annotated[
        str | None, typer.Option(help="Use rows of one kind: position|pose|sphere|plane|socket|distance. Default: all.")
    ] = None,
    model: Annotated[
        str,
        typer.Option(
            help="auto, registration, geometry, poe or zeros; with effects: geometry+compliance+backlash; with error "
            "maps: geometry+kriging."
        ),
    ] = "auto",
    compare: Annotated[
        list[str] | None,
        typer.Option(help="Fit auto and this model on the same rows (may be repeated; usual: some others)."),
    ] = None,
    artefact: Annotated[
        Path | None, typer.Option(help="File with spheres, sockets, certified distances; a cell file is one.")
    ] = None,
    distances: Annotated[bool, typer.Option(help="Use the artefact's certified distances.")] = True,
    spacing: Annotated[
        list[str] | None, typer.Option(help="A known distance, mm and 1 σ: A,B=50±0.01 (may be repeated).")
    ] = None,
    own: Annotated[str, typer.Option(help="Fit for each session: base, tool, base,tool or none.")] = "base",
    prior: Annotated[
        Path | None,
        typer.Option(help="Model of this robot to update (robot, tool or instrument moved)."),
    ] = None,
    free: Annotated[
        str | None,
        typer.Option(help="Only these groups change: zeros,tool,base,links,geometry,points,datums or effects."),
    ] = None,
    prior_of_type: Annotated[
        Path | None, typer.Option(help="What other robots of this type were like, as `cellctl prior` writes it.")
    ] = None,
    tip: Annotated[str | None, typer.Option(help="Of a robot given as URDF: its last link, if links branch.")] = None,
    repeatability: Annotated[
        float | None, typer.Option(help="Of a robot given as URDF: 1 σ, 3-D, mm.", min=0.001, max=100.0)
    ] = None,
    check: Annotated[bool, typer.Option(help="Check for set-up errors first: units, signs, order of rows.")] = True,
    holdout: Annotated[float | None, typer.Option(help="Hold out this share of the rows, at random.")] = None,
    folds: Annotated[int | None, typer.Option(help="Cross-validate with K folds. Default: column set, else 5.")] = None,
    column: Annotated[str | None, typer.Option(help="Column with fit or test for each row, such as set.")] = None,
    by: Annotated[str | None, typer.Option(help="Hold out each value of this column in turn, such as session.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random hold-out.")] = 0,
    processes: Annotated[
        int | None, typer.Option(min=1, help="Processes for the folds. Default: processors, for a long fit.")
    ] = None,
    out: Annotated[Path | None, typer.Option("-o", "--out", help="Write the model to this file.")] = None,
    page: Annotated[Path | None, typer.Option("--report", help="Write an HTML report to this file.")] = None,
    json_: arguments.Json = None,
) -> None:
    """Identify a robot; compare it with nominal on held-out rows.

    Ends with 0 where the identified robot is better than nominal (and holds against the prior model), 1 where it is
    not, 2 where the input is wrong.

    Example: cellctl fit ur10 ur10.csv --column set --out model.json

    Same robot, instrument moved: cellctl fit robot.yaml ten.csv --prior model.json --out moved.json

    After a crash: cellctl fit robot.yaml ten.csv --prior model.json --free zeros --out model2.json

    Several models: cellctl fit ur10 ur10.csv --compare usual --report compared.html

    From a URDF: cellctl fit robot.urdf data.csv --tip tool0 --repeatability 0.05
    """
    began = time.perf_counter()
    judging = Judging(holdout, folds, column, by, seed)
    asked = Asked(measure, model, artefact, distances, spacing or (), own, prior, free, prior_of_type)
    asked.refuse(judging)
    refuse_outputs({"--out": out, "--report": page, "--json": json_}, [robot, data, artefact, prior, prior_of_type])
    given = FitInput.load(robot, data, asked, tip=tip, repeatability=repeatability)
    if compare:
        _compare(
            given,
            asked,
            judging,
            compare,
            check=check,
            processes=processes,
            out=out,
            page=page,
            json_=json_,
        )
        return

    found = fit_rows(given, asked, judging, shown_progress, check=check, processes=processes)
    report, unwritten = found.report, Unwritten()
    if out:
        with unwritten.noted():
            found.model().save(out)
    if page:
        with unwritten.noted():
            write_atomically(page, found.page(shown_name(robot), shown_name(data)))
    with unwritten.noted():
        write_json({**report, "seconds": round(time.perf_counter() - began, 3)}, json_)
    if json_ != "-":
        show(report)
    name_rows(report)
    unwritten.refuse()
    if report["verdict"] != "better":
        raise typer.Exit(Exit.NOT_BETTER)


def _compare(
    given: FitInput,
    asked: Asked,
    judging: Judging,
    models: Sequence[str],
    *,
    check: bool,
    processes: int | None,
    out: Path | None,
    page: Path | None,
    json_: str | None,
) -> None:
    problems = [option("out", "a comparison writes no model", "fit the one that you choose")] if out else []
    if asked.model != "auto" or asked.prior or asked.free or asked.prior_of_type:
        cure = "name the models by --compare alone"
        problems.append(option("compare", "does not go with --model, --prior, --prior-of-type or --free", cure))
    if problems:
        raise InputError(problems)
    unwritten = Unwritten()
    found = compare_fits(given, asked, judging, models, shown_progress, check=check, processes=processes)
    if page:
        from cellctl.report.compared_fits import compared_page  # here: matplotlib takes a second

        with unwritten.noted():
            write_atomically(page, compared_page(found, given.robot.name, given.sources))
    with unwritten.noted():
        write_json(found.report(), json_)
    if json_ != "-":
        show_compared(found)
    unwritten.refuse()


def predict(
    model: Annotated[Path, typer.Argument(help="Model file, as `cellctl fit --out` writes it.")],
    joints: Annotated[Path, typer.Argument(help="CSV with A1…An (deg) or q1…qn (rad); other columns do not matter.")],
    out: arguments.Out = None,
    json_: arguments.Json = None,
    frame: Annotated[str, typer.Option(help="Frame of σ: base, or points (what was touched).")] = "base",
) -> None:
    """Predict the TCP at given joints: pose and 1 σ (3-D, mm).

    Output columns: A1…An, X, Y, Z, A, B, C, sigma, sigma_among, seen. seen: 1 within the joints of the fit, 0 outside
    (extrapolated, with a larger σ). sigma: in the model's base frame; touches do not determine its heading and height.
    With `--frame points` it is relative to what was touched, as in `cellctl compensate`; for a model from an instrument
    both are the same. sigma_among: of the rows relative to each other; empty for fewer than four rows. 95 % of places
    are within σ times radius_95 of the JSON. Optional columns temperature, payload, payload_x…z and D1…Dn give the
    conditions of each row. A payload between those of the fit is interpolated; one beyond them, or with another centre
    of gravity, is refused.

    Example: cellctl predict model.json joints.csv -o tcp.csv
    """
    refuse_json_on_stdout(json_, out, "the CSV")
    refuse_outputs({"--out": out, "--json": json_}, [model, joints])
    found = predict_rows(ModelFile.load(model), DataSet.load(joints), frame=frame)
    rows, outside = len(found.readings), int((~found.inside).sum())
    if out:
        write_atomically(out, found.text())
    else:
        to_stdout(found.text())
    figures = {"rows": rows, "outside_region": outside, "radius_95": found.radius_95}
    write_json({**figures, "file": str(out) if out else None}, json_)
    if outside:
        seen = f"{outside} of {rows} rows lie outside the joints of the fit (seen = 0)"
        typer.echo(f"cellctl: {seen}: their σ is wider by what the model may be wrong by there", err=True)
    for words in found.assumed:
        typer.echo(f"cellctl: {words}", err=True)
