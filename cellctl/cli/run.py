"""`cellctl check` and `run`: check a procedure and its cell; run it, and print the outcome."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from cellctl.cli import arguments
from cellctl.cli.arguments import refuse_outputs, write_json
from cellctl.cli.exit_codes import NOTHING_MOVED, adding
from cellctl.cli.run_progress import (
    ConfirmingAtTerminal,
    exit_of,
    interactive,
    keep_json,
    progress,
    report_of,
    show_end,
    show_warnings,
)
from cellctl.files import InputError, Problem
from cellctl.operations.campaign import load_campaign
from cellctl.operations.launch import Options, PreparedRun, new_run, parent_of_run, run_to_resume
from cellctl.operations.package_check import check_package
from cellctl.operations.run_control import failing_into


def check(
    procedure: arguments.AnyProcedure = None,
    cell: arguments.OtherCell = None,
    set_: arguments.Settings = None,
    runs: arguments.Runs = Path("runs"),
    json_: arguments.Json = None,
    package: Annotated[
        str | None, typer.Option(help="Check this installed extension instead, see docs/extend.")
    ] = None,
) -> None:
    """Check a procedure and its cell; nothing moves.

    Prints all errors with file, line and remedy. Prints warnings too; they do not change the exit code.

    Example: cellctl check sphere_selfcal
    Example: cellctl check --package my_package
    """
    refuse_outputs({"--json": json_}, [procedure, cell])
    if package and not procedure:
        _check_package(package, json_)
        return
    if package or not procedure:
        raise typer.BadParameter("name a procedure, or a package with --package")
    try:
        campaign = load_campaign(procedure, cell, set_ or [], runs=runs)
    except InputError as error:
        write_json({"procedure": str(procedure), "mistakes": _listed(error.problems)}, json_)
        raise
    show_warnings(campaign.cell)
    devices = sorted(campaign.cell.addresses)
    if json_ != "-":
        typer.echo(f"{procedure}: no errors found (cell '{campaign.cell.name}': {', '.join(devices)}).")
    found: dict[str, Any] = {"mistakes": [], "warnings": _listed(campaign.cell.warnings)}
    write_json({"procedure": str(procedure), "cell": campaign.cell.name, "devices": devices, **found}, json_)


def _check_package(name: str, json_: str | None) -> None:
    found = check_package(name)
    parts = {"entry_points": list(found.entry_points), "files": list(found.files)}
    write_json({"package": name, **parts, "mistakes": _listed(found.problems)}, json_)
    if found.problems:
        raise InputError(found.problems)
    if json_ != "-":
        counted = f"{len(found.entry_points)} entry points, {len(found.files)} procedures and cells"
        typer.echo(f"{name}: no errors found ({counted}).")


def _listed(problems: Iterable[Problem]) -> list[dict[str, Any]]:
    return [asdict(problem) for problem in problems]


def run(
    procedure: arguments.Procedure,
    cell: arguments.OtherCell = None,
    set_: arguments.Settings = None,
    seed: Annotated[int | None, typer.Option(help="Seed of plan and simulated errors.", min=0)] = None,
    clock: Annotated[Literal["realtime", "lockstep"] | None, typer.Option(help="Time of a simulated cell.")] = None,
    runs: Annotated[Path, typer.Option(help="Parent folder of the run folder.")] = Path("runs"),
    resume: Annotated[Path | None, typer.Option(help="Continue this run (folder or name).")] = None,
    acknowledge: Annotated[bool, typer.Option(help="With --resume: I have checked the robot; it may move.")] = False,
    json_: arguments.Json = None,
    detached: Annotated[
        bool, typer.Option(help="Continue when the parent process ends. Runs under nohup and setsid do so anyway.")
    ] = False,
    operator: Annotated[str | None, typer.Option(help="Name for journal and report. Default: the user's.")] = None,
    confirm_all: Annotated[bool, typer.Option(help="Confirm every `confirm` step without asking.")] = False,
    folder: Annotated[Path | None, typer.Option("--folder", hidden=True, help="A folder made for this run.")] = None,
    simulator: Annotated[list[str] | None, typer.Option("--simulator", hidden=True)] = None,
    index: arguments.Index = None,
) -> None:
    """Run a procedure on its cell, after the checks of `check`.

    The cell file states whether the cell is real or simulated.

    Ctrl-C, SIGTERM, a closed terminal and the end of the parent process abort the run. The clean-up still runs.

    Example: cellctl run sphere_selfcal --seed 3 --json result.json
    """
    to_stdout = json_ == "-"
    asking = ConfirmingAtTerminal if interactive() and not to_stdout else None
    with failing_into((folder or resume) if detached else None), adding(NOTHING_MOVED):
        _refuse_options(resume, acknowledge, seed, clock)
        refuse_outputs({"--json": json_}, [procedure, cell])
        campaign = load_campaign(
            procedure, cell, set_ or [], seed=seed, resumed=resume is not None, runs=folder.parent if folder else runs
        )
        refuse_outputs({"--json": json_}, [Path(campaign.cell.document.file), campaign.cell.robot_file])
        show_warnings(campaign.cell)
        extra, parent = tuple(simulator or ()), parent_of_run(detached=detached)
        options = Options(seed, clock, extra, None, acknowledge, parent, confirm_all, asking)
        if operator:
            options = replace(options, operator=operator)
        if resume:
            prepared = run_to_resume(campaign, runs, resume, set_ or [], options)
        else:
            prepared = PreparedRun(campaign, folder, options) if folder else new_run(campaign, runs, options)
    if prepared.table:
        typer.echo(f"cellctl: {prepared.table}", err=True)
    with (
        failing_into(prepared.folder if detached else None),
        adding(NOTHING_MOVED),
        progress(campaign, prepared.folder, quiet=to_stdout) as watcher,
    ):
        outcome, result = prepared.carry_out(watcher)
    show_end(outcome, result, prepared.folder, quiet=to_stdout)
    keep_json(result, json_, prepared.folder)
    report_of(prepared.folder)
    raise typer.Exit(exit_of(outcome))


def _refuse_options(resume: Path | None, acknowledge: bool, seed: int | None, clock: str | None) -> None:
    """Raise InputError for options that do not apply to a new run, or to a resumed one."""
    if resume is None:
        cure = "give --resume RUN with it, or leave it out"
        problems = [Problem("--acknowledge", 0, 0, "goes with a run that is resumed", cure)] if acknowledge else []
    else:
        cure = "leave it out, or run the procedure anew"
        given = {"--seed": seed, "--clock": clock}
        problems = [
            Problem(option, 0, 0, "a resumed run keeps the one that it was begun with", cure)
            for option, value in given.items()
            if value is not None
        ]
    if problems:
        raise InputError(problems)
