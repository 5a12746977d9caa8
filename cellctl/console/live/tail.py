"""Reads what was added to a journal. The file is open only while it is read.

A writer merges its write-ahead log into the journal when it ends, and cannot while another program has the file open:
a reader that keeps it open would leave the last events beside the journal.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import final

from cellctl.console.live.unexpected import unexpected
from cellctl.engine.status import KnownProcedure
from cellctl.files import Problem
from cellctl.journal import Entry, JournalError, RunStarted, Writer, read_journal, writer_of
from cellctl.journal.journal_file import FILE_NAME, LOCK_NAME
from cellctl.procedure import StepRegistry

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
