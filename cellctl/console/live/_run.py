"""One run, followed by its journal: what was added since the last look, its log, and a snapshot for pages.

A writer merges its write-ahead log into the journal when it ends, and cannot while another program has the file open:
a reader that keeps it open would leave the last events beside the journal.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from itertools import islice
from pathlib import Path
from typing import Literal, final

from cellctl.engine.status import KnownProcedure, RunProgress, Status
from cellctl.engine.step_tree import Node
from cellctl.files import Problem
from cellctl.journal import (
    DevicesConnected,
    Entry,
    Event,
    InterlockChanged,
    JournalError,
    OperatorAction,
    Outcome,
    Recorded,
    RecordedRow,
    RunEnded,
    RunResumed,
    RunStarted,
    RunState,
    Said,
    StateChanged,
    StepEnded,
    Writer,
    read_journal,
    writer_of,
)
from cellctl.journal.journal_file import FILE_NAME, LOCK_NAME
from cellctl.operations.run_list import UNREADABLE
from cellctl.procedure import StepRegistry
from cellctl.records import VerdictRow


def unexpected(run_folder: Path, error: Exception) -> Problem:
    """The problem to show for `error`; its traceback goes to the log."""
    logging.getLogger(__name__).error("%s cannot be shown", run_folder, exc_info=error)
    what = f"it cannot be shown: {type(error).__name__}: {error}"
    return Problem(str(run_folder), 0, 0, what, "look at it with `cellctl show --events`, and report the error")


_SLICE = 500
"""Number of events that one look reads at most: a few milliseconds of work for the event loop."""

_RARELY = 64
"""Of a written run, an unchanged journal is read at least once in this number of looks."""

Stamp = tuple[int, int, int] | None
"""Inode, size in bytes and time of the last change (ns) of a file; None: there is none."""


def stamp(path: Path) -> Stamp:
    """The stamp of a file: another one after each change."""
    try:
        found = path.stat()
    except (OSError, ValueError):  # ValueError: a name that no file can have
        return None
    return found.st_ino, found.st_size, found.st_mtime_ns


def stamps(run_folder: Path) -> tuple[Stamp, Stamp]:
    """Stamps of a journal and of its write-ahead log."""
    return stamp(run_folder / FILE_NAME), stamp(run_folder / f"{FILE_NAME}-wal")


@final
@dataclass(frozen=True, slots=True)
class Found:
    """What a look found. `entries`: added events; `more`: there are further ones; `replaced`: from another file.

    `writer`: the process that writes the run now. `problem`: why the rest cannot be read. `known`: the procedure,
    with the first event, if this version can read it.
    """

    entries: tuple[Entry, ...]
    writer: Writer | None
    problem: Problem | None
    known: KnownProcedure | None = None
    replaced: bool = False
    more: bool = False


@final
class JournalTail:
    """Looks at one run, again and again; an unchanged one costs three file stamps. Use it from one thread at a time.

    A commit changes the stamps when it is written, and can be read only when it is on the disk, which a busy disk
    delays. So an unchanged journal is read again after 1, 2, 4 … looks, as long as a process writes it.
    """

    def __init__(self, run_folder: Path, registry: Callable[[], StepRegistry]) -> None:
        self._folder, self._registry = run_folder, registry
        self._stamps: tuple[Stamp, Stamp] | None = None
        self._lock_stamp: Stamp = None
        self._writer: Writer | None = None
        self._problem: Problem | None = None
        self._seq = self._unchanged = 0
        self._more = False

    def look(self) -> Found | None:
        """What was added since the last look; None if nothing changed. Raises nothing: see `Found.problem`."""
        writer_before, self._writer = self._writer, self._writer_now()
        now, before = stamps(self._folder), self._stamps
        self._unchanged = self._unchanged + 1 if now == before else 0
        if self._unchanged and not self._more and not self._due():
            return Found((), self._writer, self._problem) if self._writer != writer_before else None
        self._stamps = now
        replaced = bool(before and before[0] and (now[0] is None or now[0][0] != before[0][0]))
        if replaced:
            self._seq = 0
        state_before, more_before = (writer_before, self._problem), self._more
        entries = self._read()
        unchanged = before is not None and not replaced and (self._writer, self._problem) == state_before
        if unchanged and not entries and not more_before:
            return None
        self._more = len(entries) == _SLICE
        return Found(tuple(entries), self._writer, self._problem, self._known(entries), replaced, self._more)

    def _due(self) -> bool:
        """Whether to read an unchanged journal: once, as two commits may have one stamp; often if it is written."""
        looks = self._unchanged
        return looks == 1 or (self._writer is not None and (looks & (looks - 1) == 0 or looks % _RARELY == 0))

    def _read(self) -> list[Entry]:
        entries: list[Entry] = []
        self._problem = None
        try:
            entries.extend(islice(read_journal(self._folder / FILE_NAME, self._seq), _SLICE))
        except JournalError as error:
            self._problem = Problem(str(error.path), 0, 0, error.what, error.cure)
        except Exception as error:
            self._problem = unexpected(self._folder, error)
        if entries:
            self._seq = entries[-1].seq
        return entries

    def _known(self, entries: list[Entry]) -> KnownProcedure | None:
        events = (entry.event for entry in entries)
        started = next((event for event in events if isinstance(event, RunStarted)), None)
        try:
            return KnownProcedure.of(started, self._registry()) if started else None
        except Exception as error:  # of a step's own code: the run is shown without its tree
            unexpected(self._folder, error)
            return None

    def _writer_now(self) -> Writer | None:
        """The process that writes the run.

        To ask takes the lock for a moment if it is free. A process that wants it at that moment would be refused: it
        is asked only after the lock's file has changed, which the process does when it has the lock.
        """
        now = stamp(self._folder / LOCK_NAME)
        if self._writer is None and (now == self._lock_stamp or now is None or now[1] == 0):
            return None
        self._lock_stamp = now
        return writer_of(self._folder / FILE_NAME)


LogKind = Literal["message", "state", "operator", "interlock", "failure", "device"]


@final
@dataclass(frozen=True, slots=True)
class LogLine:
    """A line of the log. `seq`: of its event; `time_s`: of the cell's time, s; `who`: an operator, else empty.

    `clock`: calendar time, UTC, ISO 8601; empty where the event states none and the cell's time is not real time.
    """

    seq: int
    time_s: float
    kind: LogKind
    text: str
    who: str = ""
    step: str = ""
    clock: str = ""

    def fits(self, kind: str, text: str) -> bool:
        """Whether the line is of this kind and has this text in line, step or person; empty: any."""
        return kind in ("", self.kind) and text.casefold() in f"{self.text} {self.who} {self.step}".casefold()


@final
class LogLines:
    """The lines of a run's log, event by event."""

    def __init__(self) -> None:
        self._began: tuple[datetime, int] | None = None

    def of(self, entry: Entry) -> LogLine | None:
        """The line for an event; None for events that the log leaves out, such as measured rows."""
        calendar = _iso(str(getattr(entry.event, "calendar", "")))
        if isinstance(entry.event, RunStarted | RunResumed) and calendar:
            realtime = getattr(entry.event, "clock", "realtime" if self._began else "") == "realtime"
            self._began = (datetime.fromisoformat(calendar), entry.time_ns) if realtime else None
        line = _log_line(entry)
        if line is None:
            return None
        if self._began:
            since = timedelta(microseconds=(entry.time_ns - self._began[1]) / 1000)
            calendar = (self._began[0] + since).isoformat()
        return replace(line, clock=calendar)


def _iso(text: str) -> str:
    """`text` if it is a time; empty for what another program wrote."""
    try:
        return datetime.fromisoformat(text).isoformat()
    except ValueError:
        return ""


def _log_line(entry: Entry) -> LogLine | None:
    found = _text(entry.event)
    if found is None:
        return None
    kind, text = found
    who = entry.event.operator if isinstance(entry.event, OperatorAction | RunStarted | RunResumed) else ""
    step = entry.event.step if isinstance(entry.event, Said | StepEnded) else ""
    return LogLine(entry.seq, entry.time_ns * 1e-9, kind, text, who, step)


def whole_log(run_folder: Path) -> tuple[LogLine, ...]:
    """All lines of a run; reads its whole journal. Raises JournalError."""
    lines = map(LogLines().of, read_journal(run_folder))
    return tuple(line for line in lines if line is not None)


def _text(event: Event) -> tuple[LogKind, str] | None:
    match event:
        case Said(text=text):
            return "message", text
        case RunStarted():
            return "state", f"started by {event.operator} with seed {event.seed}, clock {event.clock}"
        case RunResumed():
            return "state", f"resumed by {event.operator}" + (", who checked the cell" if event.acknowledged else "")
        case DevicesConnected(identities):
            return "device", f"connected: {', '.join(identities)}"
        case StateChanged(after=after, reason=reason):
            return "state", f"{after}: {reason}" if reason else after
        case RunEnded():
            return "state", ", ".join(filter(None, (f"ended: {event.state}", event.verdict, event.reason)))
        case OperatorAction():
            return "operator", _action(event)
        case InterlockChanged(interlock=name, holds=holds, text=text):
            return "interlock", f"{name} {'holds again' if holds else 'does not hold'}: {text}"
        case StepEnded(outcome=outcome, attempt=attempt, failure=failure) if outcome is not Outcome.DONE:
            how = f"attempt {attempt} {outcome.value.replace('_', ' ')}"
            return "failure", f"{event.step}: {how}" + (f": {failure.text}" if failure and failure.text else "")
        case _:
            return None


def _action(event: OperatorAction) -> str:
    text = event.action + (f": {event.text}" if event.text else "")
    return f"{text}, refused: {event.refused}" if event.refused else text


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
        self._lines = LogLines()
        self._verdicts: list[RecordedRow] = []
        self._broken = False

    def _apply(self, entry: Entry) -> None:
        self._progress.apply(entry)
        if isinstance(entry.event, Recorded) and entry.event.row_kind == VerdictRow.KIND:
            self._verdicts.append(self._progress.state.rows[-1])
        line = self._lines.of(entry)
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
