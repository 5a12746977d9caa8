"""`cellctl run`: check a procedure, run it, say how it ended."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer


def run(
    procedure: Annotated[Path, typer.Argument(help="Procedure file.")],
    cell: Annotated[Path | None, typer.Option(help="Cell file instead of the one that the procedure names.")] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", help="A parameter, name=value; may be repeated.")] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of the plan, and of a simulated cell's errors.", min=0)] = None,
    clock: Annotated[Literal["realtime", "lockstep"] | None, typer.Option(help="A simulated cell's time.")] = None,
    runs: Annotated[Path, typer.Option(help="Folder for the run's folder.")] = Path("runs"),
    resume: Annotated[Path | None, typer.Option(help="Go on with this run (its folder, or its name).")] = None,
    acknowledge: Annotated[bool, typer.Option(help="With --resume: I have looked at the robot, it may move.")] = False,
    json_: Annotated[
        str | None, typer.Option("--json", help="Write the result as JSON to this file; - for stdout.")
    ] = None,
    detached: Annotated[
        bool, typer.Option(help="Go on when the process that started this one ends; so do runs under nohup and setsid.")
    ] = False,
    confirm_all: Annotated[bool, typer.Option(help="Confirm every `confirm` step at once: nobody is asked.")] = False,
    simulator: Annotated[list[str] | None, typer.Option("--simulator", hidden=True)] = None,
) -> None:
    """Check a procedure and run it on its cell (simulated where the cell file says so).

    Ctrl-C, SIGTERM, a closed terminal and the end of the process that started it abort the run, with its clean-up.

    Example: cellctl run procedures/sphere_selfcal.yaml --seed 3 --json result.json
    """
    import asyncio
    import time

    from cellctl.cli.campaign import load_campaign
    from cellctl.cli.cell_warnings import say_warnings
    from cellctl.cli.launch import Options, run_campaign
    from cellctl.cli.outputs import refuse_outputs
    from cellctl.cli.parent import parent_of_run
    from cellctl.cli.progress import progress
    from cellctl.cli.results import (
        exit_of,
        keep_json,
        new_run_folder,
        report_of,
        result_of,
        say_end,
        table_line,
    )
    from cellctl.cli.resume import resumed_run

    parent = parent_of_run(detached=detached)
    refuse_outputs({"--json": json_}, [procedure, cell])
    campaign = load_campaign(procedure, cell, set_ or [])
    refuse_outputs({"--json": json_}, [Path(campaign.cell.document.file), campaign.cell.robot_file])
    say_warnings(campaign.cell)
    if resume:
        going_on = resumed_run(campaign, runs, resume, set_ or [], acknowledged=acknowledge)
        campaign, folder = going_on.campaign, going_on.folder
        seed, clock, resumed = going_on.seed, going_on.clock, going_on.state
        if said := table_line(going_on.state, folder):
            typer.echo(f"cellctl: {said}", err=True)
    else:
        folder = new_run_folder(runs, campaign.procedure.name)
        resumed = None
    to_stdout = json_ == "-"
    extra, ask = tuple(simulator or ()), not to_stdout
    options = Options(seed, clock, extra, resumed, acknowledge, parent, confirm_all, ask)
    began = time.monotonic()
    with progress(campaign, folder, quiet=to_stdout) as watcher:
        outcome = asyncio.run(run_campaign(campaign, options, folder, watcher))
    result: dict[str, Any] = result_of(folder, outcome, time.monotonic() - began)
    say_end(outcome, result, folder, quiet=to_stdout)
    keep_json(result, json_, folder)
    report_of(folder)
    raise typer.Exit(exit_of(outcome))
