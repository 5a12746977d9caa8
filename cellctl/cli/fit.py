"""`cellctl fit`: a model from robot file and data set, judged on held-out rows."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, final

import typer

from cellctl.cli import arguments
from cellctl.cli.arguments import shown_name
from cellctl.cli.ends import Exit
from cellctl.cli.fit_options import Asked, Judging
from cellctl.cli.outputs import Unwritten, refuse_outputs
from cellctl.files import Document, InputError, Problem, load_yaml

if TYPE_CHECKING:
    from cellctl.formats import Measurements, ModelFile, RobotFile

NO_CHECK = "--no-check skips this check and fits anyway: do not use such a model before you know the cause"


def fit(
    robot: arguments.Robot,
    data: Annotated[Path, typer.Argument(help="Data set, CSV (docs/reference/data-sets.md).")],
    measure: Annotated[
        str | None, typer.Option(help="Use rows of one kind: position|pose|sphere|plane|socket|distance. Default: all.")
    ] = None,
    model: Annotated[
        str, typer.Option(help="auto, registration, geometry or zeros, and effects: geometry+compliance+backlash.")
    ] = "auto",
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
    check: Annotated[bool, typer.Option(help="Check for set-up errors first: units, signs, order of rows.")] = True,
    holdout: Annotated[float | None, typer.Option(help="Hold out this share of the rows, at random.")] = None,
    folds: Annotated[int | None, typer.Option(help="Cross-validate with K folds. Default: column set, else 5.")] = None,
    column: Annotated[str | None, typer.Option(help="Column with fit or test for each row, such as set.")] = None,
    by: Annotated[str | None, typer.Option(help="Hold out each value of this column in turn, such as session.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random hold-out.")] = 0,
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
    """
    began = time.perf_counter()
    judging = Judging(holdout, folds, column, by, seed)
    asked = Asked(measure, model, artefact, distances, spacing or (), own, prior, free)
    asked.refuse(judging)
    refuse_outputs({"--out": out, "--report": page, "--json": json_}, [robot, data, artefact, prior])
    from cellctl.calibration import fit as fitted
    from cellctl.cli.fit_progress import shown_progress
    from cellctl.cli.fit_split import split_of
    from cellctl.cli.fit_words import name_rows, show
    from cellctl.cli.outputs import write_json
    from cellctl.formats import ModelFile, fit_report
    from cellctl.formats.measurements import refuse_alike
    from cellctl.formats.setup_refusals import SetupFiles, refuse_setup_errors

    files = _Files.of(robot, data, asked)
    measured = _measured(files, asked)
    refuse_alike(measured)
    split, labels = split_of(measured, judging)
    if check and not asked.free_groups:  # free parameters may deviate as much as an error would
        with shown_progress("check") as progress:
            refuse_setup_errors(measured, SetupFiles(files.document, data, artefact), NO_CHECK, progress)
    with shown_progress("fit") as progress:
        result = fitted(measured.task, split, progress)
    report = fit_report(measured, result, labels)
    unwritten = Unwritten()
    if out:
        with unwritten.noted():
            ModelFile.of(files.robot, measured, result, files.hashes, files.prior).save(out)
    if page:
        from cellctl.report.fit import FitStory, write_fit_page

        sources = {
            "robot file": shown_name(robot),
            "data set": f"{shown_name(data)}, SHA-256 {files.data.sha256[:12]}…",
        }
        with unwritten.noted():
            write_fit_page(page, FitStory.of(measured, result, split, report, sources))
    with unwritten.noted():
        write_json({**report, "seconds": round(time.perf_counter() - began, 3)}, json_)
    if json_ != "-":
        show(report)
    name_rows(report)
    unwritten.refuse()
    if report["verdict"] != "better":
        raise typer.Exit(Exit.NOT_BETTER)


@final
@dataclass(frozen=True)
class _Files:
    """The files read, and their hashes for the model."""

    document: Document
    robot: RobotFile
    data: Any
    artefact: Any
    prior: ModelFile | None
    hashes: dict[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, robot: Path, data: Path, asked: Asked) -> _Files:
        """Read all files; reports all their errors at once."""
        from cellctl.files import sha256_of
        from cellctl.formats import DataSet, ModelFile, load_artefact

        artefact, prior = asked.artefact, asked.prior
        loaders: list[Callable[[], Any]] = [lambda: _robot(robot), lambda: DataSet.load(data)]
        loaders.append(lambda: load_artefact(artefact) if artefact else None)
        loaders.append(lambda: ModelFile.load(prior) if prior else None)
        try:
            (document, robot_file), rows, points, older = _all_of(loaders)
        except InputError as error:
            if _is_robot(data):
                what = f"is taken for the robot file, and the data set {data} is a robot file: they are swapped"
                cure = f"cellctl fit {data} {robot}"
                raise InputError(Problem(str(robot), 0, 0, what, cure)) from error
            raise
        hashes = {"data_sha256": rows.sha256}
        if points:
            hashes["artefact_sha256"] = sha256_of(points.model_dump())
        if older:
            hashes["prior_sha256"] = sha256_of(older.text())
        return cls(document, robot_file, rows, points, older, hashes)


def _robot(path: Path) -> tuple[Document, RobotFile]:
    """The robot file, read once: it may change while the fit runs, or be a pipe."""
    from cellctl.formats import RobotFile

    document = load_yaml(path)
    return document, RobotFile.from_document(document)


def _is_robot(path: Path) -> bool:
    """Whether a file contains a robot, even with errors."""
    try:
        content = load_yaml(path).data
    except InputError:
        return False
    return isinstance(content, dict) and {"convention", "joints"} <= content.keys()


def _measured(files: _Files, asked: Asked) -> Measurements:
    """The usable rows for the fit."""
    from cellctl.formats import from_prior, measurements, only

    measured = measurements(
        files.robot,
        files.data,
        measure=asked.measure,  # type: ignore[arg-type]  # `Asked.refuse` has looked at it
        model=asked.model,
        artefact=files.artefact,
        use_distances=asked.distances,
        spacings=asked.spacings,
        own=asked.own_groups,
    )
    if files.prior:
        return from_prior(measured, files.prior, asked.free_groups, str(asked.prior))
    return only(measured, asked.free_groups) if asked.free_groups else measured


def _all_of(loaders: list[Callable[[], Any]]) -> list[Any]:
    loaded, problems = [], []
    for load in loaders:
        try:
            loaded.append(load())
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    return loaded
