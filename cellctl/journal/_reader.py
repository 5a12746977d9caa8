"""Reads a journal: while it is written, after a crash, years later, or damaged. Reading does not change it."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Self, final

from cellctl.journal.events import Entry, decode
from cellctl.journal.journal_file import (
    APPLICATION_ID,
    FILE_NAME,
    LOCK_NAME,
    SELECT,
    VERSION,
    JournalError,
    Writer,
    lock_holder,
    named_errors,
)


def journal_in(run: Path) -> Path:
    """The journal's file, from a run folder or from the file itself."""
    return run / FILE_NAME if run.is_dir() else run


def run_place(run: Path, runs: Path) -> Path:
    """`run` itself if that path exists, else the run of that name in the folder `runs`."""
    return run if run.exists() else runs / run


def read_journal(run: Path, after: int = 0) -> Iterator[Entry]:
    """The committed events of a run (its folder or its journal) with numbers above `after`, in order.

    Events committed during the read may be missing at the end; call again with the last number received.
    Raises JournalError if the journal is missing, damaged, of another program or of a newer version.
    """
    path = journal_in(run)
    with closing(opened_journal(path)) as connection, named_errors(path):
        for seq, time_ns, *columns in connection.execute(SELECT, (after,)):
            try:
                event = decode(tuple(columns))
            except (ValueError, TypeError) as error:
                raise JournalError(path, f"event {seq} is damaged: {error}", "restore it from a copy") from error
            yield Entry(seq, time_ns, event)


def last_number(run: Path) -> int:
    """The number of the last committed event of a run (its folder or its journal); 0: none. Raises JournalError."""
    path = journal_in(run)
    with closing(opened_journal(path)) as connection, named_errors(path):
        return connection.execute("SELECT max(seq) FROM events").fetchone()[0] or 0


def is_being_written(run: Path) -> bool:
    """Whether a process is writing this run now; if not, a run without an end event was interrupted."""
    return writer_of(run) is not None


def writer_of(run: Path) -> Writer | None:
    """The process that writes this run (its folder or its journal) now; None where none does."""
    return lock_holder(journal_in(run).parent / LOCK_NAME)


def host_of(run: Path) -> str:
    """The computer whose process writes this run, or wrote it last; empty if that is not known."""
    try:
        text = (journal_in(run).parent / LOCK_NAME).read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
    return Writer.read(text.removesuffix("\n")).host


def refuse_foreign(path: Path) -> None:
    """Raise JournalError unless `path` is a journal that this version reads."""
    opened_journal(path).close()


def opened_journal(path: Path) -> sqlite3.Connection:
    """The journal, open for reading. Raises JournalError unless it is one that this version reads."""
    connection = _opened(path)
    try:
        _refuse(path, connection)
    except JournalError:
        connection.close()
        raise
    return connection


def _opened(path: Path) -> sqlite3.Connection:
    if not path.exists():
        raise JournalError(path, "there is no journal", "check the path; `cellctl runs` lists what there is")
    with named_errors(path):
        return sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True, isolation_level=None)


def _refuse(path: Path, connection: sqlite3.Connection) -> None:
    with named_errors(path):
        application = connection.execute("PRAGMA application_id").fetchone()[0]
        version = connection.execute("PRAGMA user_version").fetchone()[0]
    if application != APPLICATION_ID:
        raise JournalError(path, "it is no journal", "name a run folder with a journal.sqlite written by cellctl")
    if version > VERSION:
        cure = "read it with the cellctl that wrote it, or a later one"
        raise JournalError(path, f"it was written by a newer cellctl (format {version}, known here: {VERSION})", cure)


_ONE = SELECT.replace("seq > ?", "seq = ?")

Row = tuple[int, int, str, str, int, str]
"""seq, time_ns, kind, step, attempt, data (JSON text) of an event as the journal's file has it."""


@final
@dataclass(frozen=True, slots=True)
class ReadableJournal:
    """The readable events of a run, in order: as rows of the file and as events; damage: the others, as text."""

    rows: tuple[Row, ...]
    entries: tuple[Entry, ...]
    damage: tuple[str, ...]

    @classmethod
    def of(cls, run: Path) -> Self:
        """Those of a run (its folder or its journal), also while it is written.

        Raises JournalError if the journal is missing, of another program or of a newer version, or if SQLite cannot
        read any event.
        """
        path = journal_in(run)
        damage: list[str] = []
        with closing(opened_journal(path)) as connection:
            found = _rows(path, connection, damage)
        rows, entries = [], []
        for row in found:
            try:
                event = decode(row[2:])
                json.loads(row[5])
            except (ValueError, TypeError) as error:
                damage.append(f"event {row[0]} is damaged: {error}")
            else:
                rows.append(row)
                entries.append(Entry(row[0], row[1], event))
        return cls(tuple(rows), tuple(entries), tuple(damage))


def _rows(path: Path, connection: sqlite3.Connection, damage: list[str]) -> list[Row]:
    found: list[Row] = []
    try:
        found.extend(connection.execute(SELECT, (0,)))
    except sqlite3.DatabaseError:
        with named_errors(path):
            last = connection.execute("SELECT max(seq) FROM events").fetchone()[0] or 0
        found = list(_one_by_one(connection, last, damage))
        if not found:
            raise JournalError(path, "no event of it can be read", "restore the run folder from a copy") from None
    return found


def _one_by_one(connection: sqlite3.Connection, last: int, damage: list[str]) -> Iterator[Row]:
    lost: list[int] = []
    for seq in range(1, last + 1):
        try:
            row = connection.execute(_ONE, (seq,)).fetchone()
        except sqlite3.DatabaseError:
            row = None
        if row is None:
            lost.append(seq)
        else:
            yield row
    if lost:
        damage.append(f"{len(lost)} of {last} events cannot be read, between event {lost[0]} and event {lost[-1]}")
