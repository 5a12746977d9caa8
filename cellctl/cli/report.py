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
    runs: arguments.Runs = Path("runs"),
    json_: arguments.Json = None,
) -> None:
    """Write the HTML report of a run again.

    Made from the journal, data set, model and table in the run folder.

    Example: cellctl report sphere_selfcal-20261121T192433Z -o report.html
    """
    from cellctl.cli.outputs import refuse_outputs, write_json
    from cellctl.journal import run_place
    from cellctl.report import FILE_NAME, write_report

    place = run_place(run, runs)
    refuse_outputs(
        {"--out": out, "--json": json_}, [place, *(file for file in place.glob("*") if file.name != FILE_NAME)]
    )
    written = write_report(place, out)
    if json_ != "-":
        typer.echo(written)
    write_json({"run": place.name, "file": str(written)}, json_)
