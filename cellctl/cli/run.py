"""`cellctl check` and `run`; `status`, `pause`, `continue`, `abort`, `confirm`, `acknowledge` for a running run."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NoReturn

import typer

from cellctl.cli import arguments

if TYPE_CHECKING:
    from cellctl.engine import ActionName
    from cellctl.engine.status import Status
    from cellctl.files import Problem


def check(
    procedure: arguments.Procedure,
    cell: arguments.OtherCell = None,
    set_: arguments.Settings = None,
    runs: arguments.Runs = Path("runs"),
    json_: arguments.Json = None,
) -> None:
    """Check a procedure and its cell; nothing moves.

    Prints all errors with file, line and remedy. Prints warnings too; they do not change the exit code.

    Example: cellctl check sphere_selfcal
    """
    from cellctl.cli.arguments import refuse_outputs, write_json
    from cellctl.cli.run_progress import show_warnings
    from cellctl.files import InputError
    from cellctl.operations.campaign import load_campaign

    refuse_outputs({"--json": json_}, [procedure, cell])
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
) -> None:
    """Run a procedure on its cell, after the checks of `check`.

    The cell file states whether the cell is real or simulated.

    Ctrl-C, SIGTERM, a closed terminal and the end of the parent process abort the run. The clean-up still runs.

    Example: cellctl run sphere_selfcal --seed 3 --json result.json
    """
    from dataclasses import replace

    from cellctl.cli.arguments import refuse_outputs
    from cellctl.cli.ends import NOTHING_MOVED, adding
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
    from cellctl.operations.campaign import load_campaign
    from cellctl.operations.launch import Options, PreparedRun, new_run, parent_of_run, run_to_resume

    to_stdout = json_ == "-"
    asking = ConfirmingAtTerminal if interactive() and not to_stdout else None
    with adding(NOTHING_MOVED):
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
    with adding(NOTHING_MOVED), progress(campaign, prepared.folder, quiet=to_stdout) as watcher:
        outcome, result = prepared.carry_out(watcher)
    show_end(outcome, result, prepared.folder, quiet=to_stdout)
    keep_json(result, json_, prepared.folder)
    report_of(prepared.folder)
    raise typer.Exit(exit_of(outcome))


def _refuse_options(resume: Path | None, acknowledge: bool, seed: int | None, clock: str | None) -> None:
    """Raise InputError for options that do not apply to a new run, or to a resumed one."""
    from cellctl.files import InputError, Problem

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


_Run = Annotated[Path | None, typer.Argument(help="Run folder or name. Default: the only active run.")]

_DONE: dict[ActionName, str] = {
    "pause": "is paused before its next step; `cellctl continue` goes on",
    "resume": "goes on",
    "abort": "is being aborted, with its clean-up",
    "confirm": "is confirmed and goes on",
    "reset": "has its simulated cell reset; it goes on, after `cellctl continue` where an operator has to say so",
}


def status(run: _Run = None, runs: arguments.Runs = Path("runs"), json_: arguments.Json = None) -> None:
    """Show state, step, progress and time left of a run.

    Shows also what the run waits for.

    Example: cellctl status --json -
    """
    from dataclasses import asdict

    from cellctl.cli.arguments import refuse_outputs, write_json
    from cellctl.engine.status import status_of
    from cellctl.journal import fold, read_journal
    from cellctl.operations.run_list import RunEnd
    from cellctl.procedure import StepRegistry

    folder = _chosen(run, runs)
    refuse_outputs({"--json": json_}, [*folder.glob("*")])
    found, state = status_of(folder, StepRegistry.installed()), fold(read_journal(folder))
    end = RunEnd.of(folder, state, running=bool(found.process))
    if json_:
        said = {name: getattr(end, name) if end else "" for name in ("problem", "cure", "sentence")}
        write_json({**asdict(found), **said}, json_)
        return
    for line in [*_lines(found), *(end.lines(folder) if end else [])]:
        typer.echo(line)


def pause(run: _Run = None, runs: arguments.Runs = Path("runs"), json_: arguments.Json = None) -> None:
    """Pause a run before its next step.

    Example: cellctl pause
    """
    _act("pause", run, runs, json_)


def continue_(run: _Run = None, runs: arguments.Runs = Path("runs"), json_: arguments.Json = None) -> None:
    """Continue a paused run, unless an interlock forbids it.

    Example: cellctl continue
    """
    _act("resume", run, runs, json_)


def abort(run: _Run = None, runs: arguments.Runs = Path("runs"), json_: arguments.Json = None) -> None:
    """Abort a run: cancel its step, then clean up.

    Example: cellctl abort sphere_selfcal-20261121T192433Z
    """
    _act("abort", run, runs, json_)


def confirm(run: _Run = None, runs: arguments.Runs = Path("runs"), json_: arguments.Json = None) -> None:
    """Confirm the step that a run waits at.

    `cellctl status` shows the text to confirm.

    Example: cellctl confirm
    """
    _act("confirm", run, runs, json_)


def acknowledge(run: _Run = None, runs: arguments.Runs = Path("runs"), json_: arguments.Json = None) -> None:
    """Press the reset of a run's simulated cell.

    It releases the emergency stop, closes the guard, and acknowledges the robot's messages. A real cell refuses it:
    there a person does this at the cell.

    Example: cellctl acknowledge
    """
    _act("reset", run, runs, json_)


def _act(name: ActionName, run: Path | None, runs: Path, json_: str | None) -> None:
    import asyncio
    from dataclasses import asdict

    from cellctl.cli.arguments import refuse_outputs, write_json
    from cellctl.engine import Operator
    from cellctl.operations.run_control import act

    folder = _chosen(run, runs)
    refuse_outputs({"--json": json_}, [*folder.glob("*")])
    done = asyncio.run(act(folder, name, Operator.here("cli")))
    if done.refused:
        _refuse_run(folder, f"'{name}' was refused: {done.refused}", "look with `cellctl status`")
    if json_:
        write_json({"run": folder.name, **asdict(done)}, json_)
        return
    typer.echo(f"{folder.name} {_DONE[name]}.")


def _chosen(run: Path | None, runs: Path) -> Path:
    """The folder of `run`, or of the only run in `runs` that is running. Raises InputError."""
    from cellctl.journal import run_place, writer_of
    from cellctl.journal.journal_file import FILE_NAME

    if run is not None:
        folder = run_place(run, runs)
        if not (folder / FILE_NAME).exists():
            _refuse_run(folder, "there is no run here", "`cellctl runs` lists the runs")
        return folder
    found = [journal.parent for journal in sorted(runs.glob(f"*/{FILE_NAME}")) if writer_of(journal)]
    if not found:
        _refuse_run(runs, "no run is running here", "name a run; `cellctl runs` lists them")
    if len(found) > 1:
        _refuse_run(
            runs, "more than one run is running here", f"name one: {', '.join(folder.name for folder in found)}"
        )
    return found[0]


def _refuse_run(place: Path, what: str, cure: str) -> NoReturn:
    from cellctl.files import InputError, Problem

    raise InputError(Problem(str(place), 0, 0, what, cure))


def _lines(found: Status) -> list[str]:
    from cellctl.cli.run_progress import time_left

    share = f" ({100 * found.done // found.total} %)" if found.total else ""
    lines = [f"{found.run}: {found.state}" + (f", process {found.process}" if found.process else "")]
    lines += [f"  held by    {found.held_by}"] if found.held_by else []
    lines += [f"  interlock  {text}" for text in found.broken if text != found.held_by]
    lines += [f"  step       {found.step}{f' ({found.phase})' if found.phase else ''}"] if found.step else []
    lines.append(f"  done       {found.done} of {found.total} steps{share}")
    lines += [f"  left       {time_left(found.left_s)}"] if found.left_s is not None else []
    lines += [f"  message    {found.message}"] if found.message else []
    return [*lines, *([f"  CONFIRM    {found.confirm}  (`cellctl confirm`)"] if found.confirm else [])]
