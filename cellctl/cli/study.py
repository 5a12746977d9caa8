"""`cellctl study`: many fits or campaigns over factors and seeds, in processes here or on a Dask cluster."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cellctl.cli import arguments
from cellctl.cli.arguments import refuse_outputs, write_json
from cellctl.cli.fit_progress import shown_progress
from cellctl.files import InputError
from cellctl.operations.fit_options import option
from cellctl.operations.fold_processes import processors
from cellctl.operations.studies.cluster import on_cluster
from cellctl.operations.studies.runner import in_processes
from cellctl.operations.studies.study import PAGE, TABLE, run_study
from cellctl.operations.studies.study_file import Study


def study(
    file: Annotated[Path, typer.Argument(metavar="STUDY.yaml", help="Study file (docs/reference/studies.md).")],
    studies: Annotated[Path, typer.Option(help="Parent folder of the study's folder.")] = Path("runs/studies"),
    scheduler: Annotated[
        str | None, typer.Option(help="Scheduler of a Dask cluster, tcp://…; default: a cluster on this computer.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Workers of the cluster here. Default: as many as processors.")
    ] = None,
    processes: Annotated[int | None, typer.Option(min=1, help="Compute in so many processes, without Dask.")] = None,
    json_: arguments.Json = None,
) -> None:
    """Run many fits or campaigns over factors and seeds; rows as Parquet, and a page.

    The same call continues an interrupted study: what is done is not computed again. Every way of computing gives the
    same bytes.

    Example: cellctl study rows-and-noise.yaml

    On a cluster: cellctl study rows-and-noise.yaml --scheduler tcp://10.0.0.5:8786
    """
    given = {"--scheduler": scheduler, "--workers": workers, "--processes": processes}
    if len(named := [name for name, value in given.items() if value is not None]) > 1:
        raise InputError(option(named[1][2:], f"does not go with {named[0]}", "give one of them"))
    refuse_outputs({"--json": json_}, [file])
    if processes:
        compute = in_processes(processes)
    else:
        compute = on_cluster(scheduler, workers or processors(), lambda text: typer.echo(f"cellctl: {text}", err=True))
    with shown_progress("study") as progress:
        found = run_study(Study.load(file), studies, compute, progress)
    write_json(
        {
            "folder": str(found.folder),
            "units": found.units,
            "rows_before": found.before,
            "rows_now": found.now,
            "table": str(found.folder / TABLE),
            "page": str(found.folder / PAGE),
        },
        json_,
    )
    if json_ != "-":
        typer.echo(f"{found.units} rows ({found.now} of this call): {found.folder / TABLE}, {found.folder / PAGE}")
