"""Operators' actions on a running campaign: pause, resume, abort, confirm, reset, from any process."""

from __future__ import annotations

from pathlib import Path

from cellctl.clock import Clock, WallClock
from cellctl.engine import ActionName, MailboxFolder, Operator
from cellctl.files import InputError, Problem
from cellctl.journal import OperatorAction, last_number, read_journal, writer_of

_PATIENCE_S = 15.0
"""Wall time within which a running engine takes an action; it looks every 0.2 s."""

_LOOK_EVERY_S = 0.1


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
    raise _refused(folder, f"this run did not take '{name}' within {_PATIENCE_S:g} s", "is its process still at work?")


async def _taken(folder: Path, number: str, seen: int, clock: Clock) -> OperatorAction | None:
    """The action `number`, once an event after event `seen` records it; None: the run ended, or took too long."""
    until = clock.now() + _PATIENCE_S
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
