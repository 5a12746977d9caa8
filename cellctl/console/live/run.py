"""One run, followed by its journal."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import final

from cellctl.console.live.log import LogLine, log_line
from cellctl.console.live.tail import Found, JournalTail
from cellctl.console.live.unexpected import unexpected
from cellctl.engine.status import RunProgress, Status
from cellctl.engine.step_tree import Node
from cellctl.files import Problem
from cellctl.journal import Entry, Recorded, RecordedRow, RunState
from cellctl.procedure import StepRegistry
from cellctl.records import VerdictRow

UNREADABLE = "unreadable"
"""State of a run of whose journal nothing can be read."""

_LINES = 1000
"""Number of the latest lines of the log that are kept; `whole_log` reads all."""


@final
@dataclass(frozen=True, slots=True)
class Snapshot:
    """A run at one moment; nothing in it changes but `state`.

    `version`: rises with each change. `events`: number of the last event. `tree`: None if this version cannot read the
    procedure. `log`: the latest lines. `verdict`: its word (`better`), `sentence`: the verdict in one sentence; empty
    without one. `writing`: a process writes the run; `ended`: it has an end event. `problem`: why the journal, or the
    rest of it, cannot be read.

    `state`: the fold of all events, shared and growing. Read it in the event loop only, and do not change it.
    """

    version: int
    run: str
    folder: Path
    events: int
    status: Status
    tree: Node | None
    log: tuple[LogLine, ...]
    verdict: str
    sentence: str
    writing: bool
    ended: bool
    problem: Problem | None
    state: RunState

    @property
    def active(self) -> bool:
        """Whether the run is in progress: a process executes it, and it has no end."""
        return self.writing and not self.ended


@final
class LiveRun:
    """Follows the run in `folder`. `read` may run in a thread; `take` and `snapshot` belong to the event loop."""

    def __init__(self, folder: Path, registry: Callable[[], StepRegistry]) -> None:
        self.folder, self.name = folder, folder.name
        self.read = JournalTail(folder, registry).look
        self._version = 0
        self._found = Found((), None, None)
        self._clear()
        self.snapshot = self._snapshot()

    @property
    def known(self) -> bool:
        """Whether `snapshot` has the journal's content: false until it was read for the first time."""
        return self._version > 0

    def look(self) -> bool:
        """Read what was added to the journal; returns whether `snapshot` is a new one. Raises nothing."""
        found = self.read()
        return found is not None and self.take(found)

    def take(self, found: Found) -> bool:
        """Add what was read; returns whether `snapshot` is a new one: not while there is more to read."""
        if found.replaced:
            self._clear()
        if self._broken:
            return False
        self._found = replace(found, entries=(), known=found.known or self._found.known)
        try:
            for entry in found.entries:
                self._apply(entry)
            if found.more:
                self._progress.tree(found.writer)  # the nodes so far: not all at once at the end
                return False
            self._version += 1
            self.snapshot = self._snapshot()
        except Exception as error:
            self._break(unexpected(self.folder, error))
        return True

    def _break(self, problem: Problem) -> None:
        """Show what was shown before, and the problem."""
        self._broken = True
        self._version += 1
        self.snapshot = replace(self.snapshot, version=self._version, problem=problem)

    def _clear(self) -> None:
        self._found = Found((), None, None)
        self._progress = RunProgress(lambda _: self._found.known)
        self._log: deque[LogLine] = deque(maxlen=_LINES)
        self._verdicts: list[RecordedRow] = []
        self._broken = False

    def _apply(self, entry: Entry) -> None:
        self._progress.apply(entry)
        if isinstance(entry.event, Recorded) and entry.event.row_kind == VerdictRow.KIND:
            self._verdicts.append(self._progress.state.rows[-1])
        line = log_line(entry)
        if line:
            self._log.append(line)

    def _snapshot(self) -> Snapshot:
        state, progress = self._progress.state, self._progress
        counting = (row.event.data for row in reversed(self._verdicts) if state.counts(row))
        verdict = next(counting, {})
        status = progress.status(self.name, self._found.writer)
        if self._found.problem and not state.last_seq:
            status = replace(status, state=UNREADABLE)
        return Snapshot(
            version=self._version,
            run=self.name,
            folder=self.folder,
            events=state.last_seq,
            status=status,
            tree=progress.tree(self._found.writer),
            log=tuple(self._log),
            verdict=str(verdict.get("verdict", "")),
            sentence=str(verdict.get("sentence", "")),
            writing=self._found.writer is not None,
            ended=state.ended is not None,
            problem=self._found.problem,
            state=state,
        )
