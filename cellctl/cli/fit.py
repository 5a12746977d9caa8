"""`cellctl fit`: a model from robot file and data set, judged on held-out rows."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from cellctl.cli import arguments
from cellctl.cli.arguments import shown_name
from cellctl.cli.ends import Exit
from cellctl.cli.outputs import Unwritten, refuse_outputs
from cellctl.operations.fit_options import Asked, Judging


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
    from cellctl.cli.fit_progress import shown_progress
    from cellctl.cli.fit_words import name_rows, show
    from cellctl.cli.outputs import write_json
    from cellctl.files import write_atomically
    from cellctl.operations.fitting import FitInput, fit_rows

    found = fit_rows(FitInput.load(robot, data, asked), asked, judging, shown_progress, check=check)
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
