"""`cellctl fit`: identify a robot from a data set, and prove it on rows that the fit never saw."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args

import typer

from cellctl.cli.ends import Exit
from cellctl.files import InputError, Problem

if TYPE_CHECKING:
    from cellctl.calibration import Split
    from cellctl.formats import Measurements

_DEFAULT_FOLDS = 5
_SHOWN = 20


def fit(
    robot: Annotated[Path, typer.Argument(help="Robot file: nominal link table, joints, base, tool.")],
    data: Annotated[Path, typer.Argument(help="Data set, CSV (docs/reference/data-sets.md).")],
    measure: Annotated[str | None, typer.Option(help="position, pose or sphere. Default: by the columns.")] = None,
    model: Annotated[
        str, typer.Option(help="geometry (link table and tool), or auto: tool deflection too, for touches with a mass.")
    ] = "auto",
    artefact: Annotated[Path | None, typer.Option(help="Spheres and certified distances; a cell file does.")] = None,
    distances: Annotated[bool, typer.Option(help="Use the artefact's certified distances.")] = True,
    prior: Annotated[Path | None, typer.Option(help="An older model to start from (not ready yet).")] = None,
    holdout: Annotated[float | None, typer.Option(help="Share of the rows to hold out, at random.")] = None,
    folds: Annotated[
        int | None, typer.Option(help=f"Judge by K folds. Default: column set, else {_DEFAULT_FOLDS}.")
    ] = None,
    column: Annotated[str | None, typer.Option(help="The column that says fit or test: set.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of what is held out at random.")] = 0,
    out: Annotated[Path | None, typer.Option(help="Write the model to this file.")] = None,
    json_: Annotated[
        str | None, typer.Option("--json", help="Write the result as JSON to this file; - for stdout.")
    ] = None,
) -> None:
    """Identify a robot from measurements and say how good it was and is, on held-out rows.

    Ends with 0 where the identified robot is better than nominal, 1 where it is not, 2 where the input is wrong.

    Example: cellctl fit procedures/robots/ur10.yaml ur10.csv --column set --out model.json
    """
    began = time.perf_counter()
    _refuse(measure, model, prior, holdout, folds, column)
    from cellctl.calibration import fit as fitted
    from cellctl.cli.results import write_json
    from cellctl.formats import ModelFile, fit_report

    measured, save = _measured(robot, data, measure, model, artefact, distances)
    result = fitted(measured.task, _split(measured, holdout, folds, column, seed))
    report = fit_report(measured, result)
    if out:
        save(lambda robot_file, hashes: ModelFile.of(robot_file, measured, result, hashes).save(out))
    if json_ != "-":
        _say(report)
    _name_rows(report)
    write_json({**report, "seconds": round(time.perf_counter() - began, 3)}, json_)
    if report["verdict"] != "better":
        raise typer.Exit(Exit.NOT_BETTER)


def _refuse(
    measure: str | None,
    model: str,
    prior: Path | None,
    holdout: float | None,
    folds: int | None,
    column: str | None,
) -> None:
    """Everything wrong with the options, at once; none is silently left out."""
    from cellctl.formats.measurements import Measure, ModelChoice

    problems = []
    if measure is not None and (measure not in get_args(Measure) or measure == "socket"):
        ready = "is not ready yet" if measure == "socket" else "is not known"
        problems.append(_option("measure", f"'{measure}' {ready}", "position, pose or sphere"))
    if model not in get_args(ModelChoice):
        problems.append(_option("model", f"'{model}' is not known, or not ready yet", "auto or geometry"))
    if prior is not None:
        problems.append(_option("prior", "starting from an older model is not ready yet", "leave it out"))
    if sum(given is not None for given in (holdout, folds, column)) > 1:
        problems.append(_option("holdout", "rows are held out in one way", "one of --holdout, --folds and --column"))
    if holdout is not None and not 0.0 < holdout < 1.0:
        problems.append(_option("holdout", f"{holdout:g} is no share", "a number between 0 and 1"))
    if folds is not None and folds < 2:
        problems.append(_option("folds", f"{folds} is too few", "2 or more"))
    if column not in (None, "set"):
        problems.append(_option("column", f"'{column}' is not known", "name the column set, with fit or test in it"))
    if problems:
        raise InputError(problems)


def _option(name: str, what: str, cure: str) -> Problem:
    return Problem(f"--{name}", 0, 0, what, cure)


def _measured(
    robot: Path, data: Path, measure: str | None, model: str, artefact: Path | None, distances: bool
) -> tuple[Measurements, Callable[[Callable[[Any, dict[str, str]], None]], None]]:
    """The usable rows, and what hands robot file and input hashes to a writer. All mistakes in the files at once."""
    from cellctl.files import sha256_of
    from cellctl.formats import DataSet, RobotFile, load_artefact, measurements

    loaders: list[Callable[[], Any]] = [lambda: RobotFile.load(robot), lambda: DataSet.load(data)]
    if artefact:
        loaders.append(lambda: load_artefact(artefact))
    robot_file, rows, *spheres = _all_of(loaders)
    hashes = {"data_sha256": rows.sha256}
    if spheres:
        hashes["artefact_sha256"] = sha256_of(spheres[0].model_dump())
    choice: dict[str, Any] = {"measure": measure, "model": model, "use_distances": distances}
    measured = measurements(robot_file, rows, artefact=spheres[0] if spheres else None, **choice)
    return measured, lambda write: write(robot_file, hashes)


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


def _split(measured: Measurements, holdout: float | None, folds: int | None, column: str | None, seed: int) -> Split:
    import numpy as np

    from cellctl.calibration import Split

    rows = len(measured.lines)
    if holdout is not None:
        return _enough(measured, Split.holdout(rows, holdout, seed))
    if folds is None and (column or any(measured.sets)):
        if not any(measured.sets):
            raise InputError(
                _option("column", "the data set has no column set", "add it, with fit or test in each row")
            )
        return _enough(measured, Split.by_column(np.array([name == "test" for name in measured.sets])))
    return _enough(measured, Split.folds(rows, min(folds or _DEFAULT_FOLDS, rows), seed))


def _enough(measured: Measurements, split: Split) -> Split:
    """`split`, unless a part of it has fewer rows than registration alone has unknowns."""
    least = measured.task.rows_at_least
    fewest = min([len(split.fit), *(len(part) for part, _ in split.judged)])
    if fewest >= least:
        return split
    what = f"{fewest} rows to fit where even the registration takes {least}"
    raise InputError(Problem("the data set", 0, 0, what, "measure more, or hold out less"))


def _say(report: dict[str, Any]) -> None:
    """The figures as a table, what cannot be seen, and the verdict as the last line."""
    from rich.console import Console
    from rich.table import Table

    table = Table("distances, mm", box=None, pad_edge=False)
    for column in ("mean", "RMS", "max"):
        table.add_column(column, justify="right")
    for name, key in (("held out, nominal", "nominal"), ("held out, identified", "test"), ("rows of the fit", "fit")):
        table.add_row(name, *_cells(report, key))
    console = Console(highlight=False, soft_wrap=True)
    console.print(table)
    seen = f"{report['rank']} of {report['n_parameters']} parameter combinations are seen"
    console.print(f"Model {report['model']}; {seen}; {report['n_fit']} rows to fit, {report['n_test']} held out.")
    sure = f"{report['predicted_volumetric_rms']:.3f} mm (1 σ, 3-D, rigid motion removed)"
    console.print(f"Foreseen over the joints of the fit: {sure}.")
    for words in report["unobservable"]:
        console.print(f"  not seen by these rows: {words}", markup=False)
    if not report["converged"]:
        console.print(f"Not converged: {report['ended']}.")
    console.print(report["sentence"], markup=False)


def _cells(report: dict[str, Any], key: str) -> list[str]:
    """Mean, RMS and max, or dashes where no row stands behind them."""
    if key != "fit" and not report["n_test"]:
        return ["–"] * 3
    return [f"{report[key][figure]:.3f}" for figure in ("mean", "rms", "max")]


def _name_rows(report: dict[str, Any]) -> None:
    """Every row that was not used, or held out and wild, on stderr, by line; the JSON has them all."""
    named = [f"line {row['line']}: not used: {row['reason']}" for row in [*report["rejected"], *report["outliers"]]]
    named += [f"line {row['line']}: {row['reason']}" for row in report["test_outliers"]]
    for words in named[:_SHOWN]:
        typer.echo(words, err=True)
    if len(named) > _SHOWN:
        typer.echo(f"… and {len(named) - _SHOWN} more such rows (--json names them all)", err=True)
