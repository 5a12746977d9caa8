"""Controls runs in other processes: starts and resumes detached ones; pauses, aborts, confirms, resets running ones."""

from __future__ import annotations

import asyncio
import json
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import final

from cellctl.clock import Clock, WallClock
from cellctl.devices.cell import Cell, ClockMode
from cellctl.devices.registry import DriverRegistry
from cellctl.engine import ActionName, MailboxFolder, Operator
from cellctl.files import InputError, Problem, write_atomically
from cellctl.journal import JournalError, OperatorAction, RunState, fold, last_number, read_journal, writer_of
from cellctl.journal.journal_file import FILE_NAME
from cellctl.operations.cell_devices import refuse_in_use
from cellctl.operations.results import Failure, as_json, from_json
from cellctl.operations.run_folder import FAILURE_NAME, OUTPUT_NAME, new_run_folder
from cellctl.procedure import load_procedure

_BEGIN_PATIENCE_S = 180.0
"""Wall time for the checks and the start of the simulators. If the process ends, the wait ends at once."""

_LOOK_EVERY_S = 0.1


@final
@dataclass(frozen=True, slots=True)
class RunOrder:
    """What to run: procedure and cell file (None: the procedure's), `name=value` settings, seed, clock."""

    procedure: Path
    cell: Path | None = None
    settings: tuple[str, ...] = ()
    seed: int | None = None
    clock: ClockMode | None = None

    def arguments(self) -> list[str]:
        """The arguments of `cellctl run`."""
        options = {"cell": self.cell, "seed": self.seed, "clock": self.clock}
        given = [f"--{name}={value}" for name, value in options.items() if value is not None]
        return [*given, *(f"--set={setting}" for setting in self.settings), "--", str(self.procedure)]

    def cell_file(self) -> Path | None:
        """The file of its cell; None if the procedure names none. Raises InputError."""
        return self.cell or load_procedure(self.procedure).cell

    def refuse_in_use(self) -> None:
        """Raise DeviceBusy if another process has a device of its cell."""
        with suppress(InputError):  # `check` reports it
            if file := self.cell_file():
                drivers = DriverRegistry()
                refuse_in_use(Cell.load(file, drivers), drivers)


async def start_detached(order: RunOrder, runs: Path, operator: str) -> Path:
    """Start a run in a new folder of `runs`; returns the folder once the journal has the run's start.

    operator: who starts it, for the journal. The output is in `output.txt` of the folder.
    Raises InputError with all errors in procedure, cell and settings, DeviceBusy if another process has a device of the
    cell; the folder is removed then.
    """
    folder = new_run_folder(runs.absolute(), load_procedure(order.procedure).name or "run")
    process = _started(folder, [f"--folder={folder}", f"--operator={operator}", *order.arguments()])
    if not await _begun(process, folder, 0):
        failure = _failure(folder, process)
        shutil.rmtree(folder, ignore_errors=True)
        await asyncio.to_thread(order.refuse_in_use)
        raise InputError(failure.problems)
    return folder


async def resume_detached(folder: Path, operator: str, *, acknowledged: bool) -> None:
    """Continue the run in `folder` at the step that it did not finish; returns once the journal has the resumption.

    acknowledged: a person checked the cell (see `question_of`). Raises InputError if the run cannot be continued,
    DeviceBusy if another process has a device of the cell.
    """
    seen = last_number(folder)
    started = _state_of(folder).started
    if started is None:
        raise InputError(Problem(str(folder), 0, 0, "this run ended before it began: nothing was moved", "start anew"))
    missing = [file for file in (started.procedure.path, started.cell.path) if not Path(file).is_file()]
    if missing:
        cure = "continue it in the folder in which it was begun: `cellctl run PROCEDURE --resume RUN`"
        raise InputError([Problem(file, 0, 0, "is not found from here", cure) for file in missing])
    order = RunOrder(Path(started.procedure.path), Path(started.cell.path))
    resumed = [f"--resume={folder.absolute()}", *(["--acknowledge"] if acknowledged else [])]
    process = _started(folder, [*resumed, f"--operator={operator}", *order.arguments()])
    if not await _begun(process, folder, seen):
        await asyncio.to_thread(order.refuse_in_use)
        raise InputError(_failure(folder, process).problems)


def question_of(folder: Path) -> str:
    """What a person has to check before the run in `folder` may continue, as text; empty: nothing. JournalError."""
    from cellctl.operations.launch import uncertainty  # imports the results of campaigns

    return uncertainty(_state_of(folder))


def _state_of(folder: Path) -> RunState:
    return fold(read_journal(folder))


def _started(folder: Path, arguments: list[str]) -> subprocess.Popen[bytes]:
    """`cellctl run` with a session of its own; a thread waits for its end, so that it leaves no zombie."""
    (folder / FAILURE_NAME).unlink(missing_ok=True)
    command = [sys.executable, "-P", "-m", "cellctl", "run", "--detached", *arguments]
    with (folder / OUTPUT_NAME).open("ab") as output:
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=output, stderr=output, start_new_session=True
        )
    threading.Thread(target=process.wait, name=f"end of {folder.name}", daemon=True).start()
    return process


async def _begun(process: subprocess.Popen[bytes], folder: Path, seen: int) -> bool:
    """Whether the run's journal gets an event after event `seen`, rather than that the process ends without one."""
    clock = WallClock()
    until = clock.now() + _BEGIN_PATIENCE_S
    while clock.now() < until:
        ended = process.poll() is not None
        if _last(folder) > seen:
            return True
        if ended:
            return False
        await clock.sleep(_LOOK_EVERY_S)
    process.terminate()
    return False


def _last(folder: Path) -> int:
    """The last event's number; 0 as long as there is no journal."""
    try:
        return last_number(folder) if (folder / FILE_NAME).exists() else 0
    except JournalError:  # it is just being made
        return 0


def _failure(folder: Path, process: subprocess.Popen[bytes]) -> Failure:
    """Why the process in `folder` ended before the run began, from the file that it left."""
    try:
        return from_json(Failure, json.loads((folder / FAILURE_NAME).read_text(encoding="utf-8")))
    except (OSError, ValueError, KeyError, TypeError):  # it was killed, or the disk is full
        return Failure.internal(f"the run's process ended with {process.returncode}; see {OUTPUT_NAME} in {folder}")


@contextmanager
def failing_into(folder: Path | None) -> Iterator[None]:
    """What the body raises is left in `folder`, of a detached run, for the process that started it."""
    try:
        yield
    except Exception as error:
        if folder and folder.is_dir():
            with suppress(OSError):
                write_atomically(folder / FAILURE_NAME, json.dumps(as_json(Failure.of(error))))
        raise


_ACTION_PATIENCE_S = 15.0
"""Wall time within which a running engine takes an action; it looks every 0.2 s."""


async def act(folder: Path, name: ActionName, operator: Operator, text: str = "") -> OperatorAction:
    """Put an action into the mailbox of the run in `folder`, and wait until its journal contains it.

    text: the reason; for `confirm` the path of the step that is confirmed: another step is not confirmed by it; empty:
    the step that waits. Returns the recorded action; its `refused` states why the engine did not do it.
    Raises InputError if the run is not running, ends before it takes the action, or does not take it; JournalError.
    """
    if writer_of(folder) is None:
        raise _refused(folder, "this run is not running", "`cellctl runs` lists the runs, `--resume` continues one")
    seen, mailbox = last_number(folder), MailboxFolder(folder)
    number = mailbox.put(name, operator, text)
    if taken := await _taken(folder, number, seen, WallClock()):
        return taken
    mailbox.withdraw(number)
    if writer_of(folder) is None:
        raise _refused(folder, f"this run ended before it took '{name}'", "look with `cellctl show`")
    raise _refused(
        folder, f"this run did not take '{name}' within {_ACTION_PATIENCE_S:g} s", "is its process still at work?"
    )


async def _taken(folder: Path, number: str, seen: int, clock: Clock) -> OperatorAction | None:
    """The action `number`, once an event after event `seen` records it; None: the run ended, or took too long."""
    until = clock.now() + _ACTION_PATIENCE_S
    while clock.now() < until:
        running = writer_of(folder) is not None
        for entry in read_journal(folder, after=seen):
            seen = entry.seq
            if isinstance(entry.event, OperatorAction) and entry.event.id == number:
                return entry.event
        if not running:
            return None
        await clock.sleep(_LOOK_EVERY_S)
    return None


def _refused(folder: Path, what: str, cure: str) -> InputError:
    return InputError(Problem(str(folder), 0, 0, what, cure))
