"""`cellctl status`, `pause`, `continue`, `abort`, `confirm`, `acknowledge`: status and control of a running run."""

from __future__ import annotations

import asyncio
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, NoReturn

import typer

from cellctl.cli import arguments
from cellctl.cli.arguments import in_minutes, refuse_outputs, write_json
from cellctl.engine import ActionName, Operator
from cellctl.engine.status import Status, status_of
from cellctl.files import InputError, Problem
from cellctl.journal import run_place, writer_of
from cellctl.journal.journal_file import FILE_NAME
from cellctl.operations.run_control import act
from cellctl.operations.run_list import RunEnd
from cellctl.procedure import StepRegistry

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
    folder = _chosen(run, runs)
    refuse_outputs({"--json": json_}, [*folder.glob("*")])
    found, state = status_of(folder, StepRegistry.installed())
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
    raise InputError(Problem(str(place), 0, 0, what, cure))


def _lines(found: Status) -> list[str]:
    share = f" ({100 * found.done // found.total} %)" if found.total else ""
    lines = [f"{found.run}: {found.state}" + (f", process {found.process}" if found.process else "")]
    lines += [f"  held by    {found.held_by}"] if found.held_by else []
    lines += [f"  interlock  {text}" for text in found.broken if text != found.held_by]
    lines += [f"  step       {found.step}{f' ({found.phase})' if found.phase else ''}"] if found.step else []
    lines.append(f"  done       {found.done} of {found.total} steps{share}")
    lines += [f"  left       {in_minutes(found.left_s)}"] if found.left_s is not None else []
    lines += [f"  message    {found.message}"] if found.message else []
    return [*lines, *([f"  CONFIRM    {found.confirm}  (`cellctl confirm`)"] if found.confirm else [])]
