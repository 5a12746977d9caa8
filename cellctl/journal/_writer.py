"""Writing a run's journal: every event is on the disk when `append` returns."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path
from typing import Self, final

from cellctl.files import write_atomically
from cellctl.journal._digests import ADD_COLUMN, digest_of, has_digests, last_event
from cellctl.journal._reader import refuse_foreign
from cellctl.journal.events import Entry, KnownEvent, encode
from cellctl.journal.journal_file import CREATE, FILE_NAME, INSERT, LOCK_NAME, JournalError, WriterLock, named_errors

_BUSY_S = 0.5
"""Longest wait of a commit while another program locks the file; it blocks the engine's loop."""


@final
class Journal:
    """The journal of one run, open for writing by this process alone.

    One transaction per event, synchronous FULL: an appended event survives a crash and a power cut.
    Use it from one thread. It is a context manager: leaving it closes the journal.
    """

    def __init__(self, path: Path, connection: sqlite3.Connection, lock: WriterLock, now_ns: Callable[[], int]) -> None:
        self.path = path
        self._connection = connection
        self._lock = lock
        self._now_ns = now_ns
        with named_errors(path):
            if not has_digests(connection):
                connection.execute(ADD_COLUMN)
            self._seq, self._digest = last_event(connection)

    @classmethod
    def create(cls, run_folder: Path, now_ns: Callable[[], int]) -> Self:
        """Begin the journal of a new run in `run_folder`, created if missing; `now_ns` gives the cell's time.

        Raises JournalError if there is one already, if it cannot be written, or if the disk is full.
        """
        path = run_folder / FILE_NAME
        with named_errors(run_folder):
            run_folder.mkdir(parents=True, exist_ok=True)
            lock = WriterLock.take(run_folder / LOCK_NAME)
        try:
            if path.exists():
                raise JournalError(path, "there is a journal already", "resume that run, or take another run folder")
            return cls(path, _created(path), lock, now_ns)
        except BaseException:
            lock.release()
            raise

    @classmethod
    def reopen(cls, run_folder: Path, now_ns: Callable[[], int]) -> Self:
        """Continue the journal in `run_folder`, to resume its run.

        Raises JournalError if it is missing, if another process writes it, or if it cannot be written.
        """
        path = run_folder / FILE_NAME
        refuse_foreign(path)
        with named_errors(run_folder):
            lock = WriterLock.take(run_folder / LOCK_NAME)
        try:
            return cls(path, _connected(path), lock, now_ns)
        except BaseException:
            lock.release()
            raise

    def append(self, event: KnownEvent) -> Entry:
        """Commit `event`; it is on the disk when this returns. Takes a few milliseconds on a common disk.

        Raises JournalError (the event is not kept, all earlier ones are), ValueError for values outside JSON.
        """
        kind, step, attempt, data = encode(event)
        row = (self._seq + 1, self._now_ns(), kind, step, attempt, data)
        digest = digest_of(row, self._digest)
        with named_errors(self.path):
            self._connection.execute(INSERT, (*row, digest))
        self._seq, self._digest = row[0], digest
        return Entry(row[0], row[1], event)

    def close(self) -> None:
        """Merge the write-ahead log into the file, so that a finished run is one file; close it. Never raises.

        While a reader has the file open, an empty log stays beside it, and the file contains all events.
        """
        with suppress(sqlite3.Error):  # with a full disk, or a reader in the middle of the file, all stays as it is
            self._connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
            self._connection.execute("PRAGMA busy_timeout = 0")
            self._connection.execute("PRAGMA journal_mode = DELETE")
        with suppress(sqlite3.Error):
            self._connection.close()
        self._lock.release()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _created(path: Path) -> sqlite3.Connection:
    """A new journal, renamed only once complete: no reader gets a partial file, not even after a crash."""
    with closing(sqlite3.connect(":memory:")) as unborn:
        unborn.executescript(CREATE)
        empty_journal = unborn.serialize()
    with named_errors(path):
        write_atomically(path, empty_journal)
    try:
        return _connected(path)
    except JournalError:
        path.unlink(missing_ok=True)  # an unwritable journal would block the next attempt
        raise


def _connected(path: Path) -> sqlite3.Connection:
    with named_errors(path):
        connection = sqlite3.connect(path, isolation_level=None, timeout=_BUSY_S)
    try:
        with named_errors(path):
            connection.execute("PRAGMA synchronous = FULL")
            connection.execute("PRAGMA journal_mode = WAL")
    except BaseException:
        connection.close()
        raise
    return connection
