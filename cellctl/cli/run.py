"""`cellctl run`: check a procedure, run it, say how it ended."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

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
    simulator: Annotated[list[str] | None, typer.Option("--simulator", hidden=True)] = None,
) -> None:
    """Check a procedure and run it on its cell (simulated where the cell file says so).

    Ctrl-C, SIGTERM, a closed terminal and the end of the process that started it abort the run, with its clean-up.

    Example: cellctl run procedures/sphere_selfcal.yaml --seed 3 --json result.json
    """
    from cellctl.cli.cell_warnings import say_warnings
    from cellctl.cli.outputs import refuse_outputs
    from cellctl.cli.progress import progress
    from cellctl.cli.run_end import exit_of, keep_json, report_of, say_end
    from cellctl.operations.campaign import load_campaign
    from cellctl.operations.launch import Options
    from cellctl.operations.parent import parent_of_run
    from cellctl.operations.start import new_run, run_to_resume

    options = Options(seed, clock, tuple(simulator or ()), None, acknowledge, parent_of_run(detached=detached))
    refuse_outputs({"--json": json_}, [procedure, cell])
    campaign = load_campaign(procedure, cell, set_ or [], seed=seed, resumed=resume is not None)
    refuse_outputs({"--json": json_}, [Path(campaign.cell.document.file), campaign.cell.robot_file])
    say_warnings(campaign.cell)
    if resume:
        prepared = run_to_resume(campaign, runs, resume, set_ or [], options)
    else:
        prepared = new_run(campaign, runs, options)
    if prepared.table:
        typer.echo(f"cellctl: {prepared.table}", err=True)
    to_stdout = json_ == "-"
    with progress(campaign, prepared.folder, quiet=to_stdout) as watcher:
        outcome, result = prepared.carry_out(watcher)
    say_end(outcome, result, prepared.folder, quiet=to_stdout)
    keep_json(result, json_, prepared.folder)
    report_of(prepared.folder)
    raise typer.Exit(exit_of(outcome))
