"""`cellctl report`: rebuilds a run's report from its folder."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cellctl.cli import arguments


def report(
    run: arguments.Run,
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", "--output", help="Output file. Default: report.html in the run folder."),
    ] = None,
    customer: Annotated[str | None, typer.Option(help="Customer, in place of the cell file's.")] = None,
    site: Annotated[str | None, typer.Option(help="Site, in place of the cell file's.")] = None,
    order: Annotated[str | None, typer.Option(help="Order, in place of the cell file's.")] = None,
    operator: Annotated[str | None, typer.Option(help="Operator, in place of the recorded name.")] = None,
    limit: Annotated[
        float | None, typer.Option(help="Acceptance limit of an error, mm, in place of the cell file's.")
    ] = None,
    runs: arguments.Runs = Path("runs"),
    json_: arguments.Json = None,
) -> None:
    """Write the calibration report of a run again, as HTML that prints on A4.

    Made from the journal, data set, model and table in the run folder. Two pages hold what a manager needs: parties,
    robot, instruments, environment, verdict, acceptance and uncertainty budget. The rest is for a metrologist.

    Example: cellctl report sphere_selfcal-20261121T192433Z --customer ACME --limit 0.2 -o report.html
    """
    from cellctl.cli.outputs import refuse_outputs, write_json
    from cellctl.journal import run_place
    from cellctl.report import FILE_NAME, write_report

    place = run_place(run, runs)
    refuse_outputs(
        {"--out": out, "--json": json_}, [place, *(file for file in place.glob("*") if file.name != FILE_NAME)]
    )
    if limit is not None and not 0.0 < limit < float("inf"):
        raise typer.BadParameter("--limit is a length in mm, above 0")
    stated = {"customer": customer, "site": site, "order": order, "operator": operator, "limit_mm": limit}
    written = write_report(place, out, {name: value for name, value in stated.items() if value is not None})
    if json_ != "-":
        typer.echo(written)
    write_json({"run": place.name, "file": str(written)}, json_)
