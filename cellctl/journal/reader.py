"""Reads a journal: while it is written, after a crash, or years later. Reading does not change it."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from cellctl.journal.codec import decode
from cellctl.journal.errors import JournalError, named_errors
from cellctl.journal.events import Entry
from cellctl.journal.lock import Writer, lock_holder
from cellctl.journal.schema import APPLICATION_ID, FILE_NAME, LOCK_NAME, SELECT, VERSION


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
