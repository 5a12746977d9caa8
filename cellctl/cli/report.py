"""`cellctl report`: a run's report, built anew from its folder."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def report(
    run: Annotated[Path, typer.Argument(help="Run folder, or its name in the folder of runs.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Write here instead of report.html in the run folder.")
    ] = None,
    runs: Annotated[Path, typer.Option("--runs", help="Folder of the runs.")] = Path("runs"),
) -> None:
    """Build a run's report anew: one HTML page, from its journal, data set, model and table.

    Example: cellctl report sphere_selfcal-20261121T192433Z -o report.html
    """
    from cellctl.cli.outputs import refuse_outputs
    from cellctl.report import FILE_NAME, write_report

    place = run if run.exists() else runs / run
    refuse_outputs({"--output": output}, [place, *(file for file in place.glob("*") if file.name != FILE_NAME)])
    typer.echo(write_report(place, output))
