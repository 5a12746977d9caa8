"""The file of a journal: its only table, the errors of opening it, and the lock of its one writer.

Writing needs POSIX locks. Reading and finding the writer work without them: on such systems no process writes.
"""

from __future__ import annotations

import os
import shlex
import socket
import sqlite3
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Self, final

from cellctl.clock import calendar_time
from cellctl.files.kinds import JOURNAL, kind_of_file, other_kind
from cellctl.files.locked import HAS_LOCKS, LockedByOther, LockedFile, locked_text

FILE_NAME: Final = "journal.sqlite"
"""In every run folder."""

LOCK_NAME: Final = "journal.lock"
"""Beside it: the writer locks it (flock) and writes its process id, the time and its command line into it."""

APPLICATION_ID: Final = 0x43454C4C
"""`CELL`: marks an SQLite file as a cellctl journal."""

VERSION: Final = 1
"""Counts changes that an older program would misread; new event kinds and new fields do not count."""

CREATE: Final = f"""
CREATE TABLE events (
  seq INTEGER PRIMARY KEY,
  time_ns INTEGER NOT NULL,
  kind TEXT NOT NULL,
  step TEXT NOT NULL,
  attempt INTEGER NOT NULL,
  data TEXT NOT NULL CHECK (json_valid(data)),
  digest TEXT
) STRICT;
CREATE TRIGGER events_are_not_changed BEFORE UPDATE ON events BEGIN SELECT RAISE(ABORT, 'the journal only grows'); END;
CREATE TRIGGER events_are_not_removed BEFORE DELETE ON events BEGIN SELECT RAISE(ABORT, 'the journal only grows'); END;
PRAGMA application_id = {APPLICATION_ID};
PRAGMA user_version = {VERSION};
"""

INSERT: Final = "INSERT INTO events (seq, time_ns, kind, step, attempt, data, digest) VALUES (?, ?, ?, ?, ?, ?, ?)"

SELECT: Final = "SELECT seq, time_ns, kind, step, attempt, data FROM events WHERE seq > ? ORDER BY seq"


_CURES = {
    sqlite3.SQLITE_FULL: ("the disk is full", "free some space; what was committed before is kept, and can be resumed"),
    sqlite3.SQLITE_READONLY: ("it cannot be written", "give yourself write access to the run folder, or take another"),
    sqlite3.SQLITE_CANTOPEN: (
        "it cannot be opened",
        "check the path and your rights; a run that crashed in a folder you may not write has to be copied first",
    ),
    sqlite3.SQLITE_BUSY: ("another program holds it", "close what else has the file open, and try again"),
    sqlite3.SQLITE_LOCKED: ("another program holds it", "close what else has the file open, and try again"),
    sqlite3.SQLITE_CORRUPT: ("it is damaged", "restore the run folder from a copy; a damaged journal is not repaired"),
    sqlite3.SQLITE_NOTADB: ("it is no journal", "name a run folder with a journal.sqlite written by cellctl"),
    sqlite3.SQLITE_IOERR: ("the disk does not do its work", "look at the disk (dmesg), then try again"),
}


class JournalError(Exception):
    """A journal cannot be written or read. `path`: its file; `cure`: what to do. Committed events are kept."""

    def __init__(self, path: Path, what: str, cure: str = "") -> None:
        self.path = path
        self.what = what
        self.cure = cure
        super().__init__(f"{path}: {what}" + (f"\n    {cure}" if cure else ""))


@contextmanager
def named_errors(path: Path) -> Iterator[None]:
    """Turn the errors of SQLite and of the file system on `path` into JournalError."""
    try:
        yield
    except sqlite3.Error as error:
        code = getattr(error, "sqlite_errorcode", 0) & 0xFF
        what, cure = _CURES.get(code, (f"SQLite says: {error}", ""))
        if code == sqlite3.SQLITE_NOTADB and (found := kind_of_file(path)):
            what = other_kind(found, JOURNAL)
        raise JournalError(path, what, cure) from error
    except OSError as error:
        cure = "check the path, your rights and the free space there"
        raise JournalError(path, f"cannot be used: {error.strerror or error}", cure) from error


@final
@dataclass(frozen=True, slots=True)
class Writer:
    """The process that writes a run: its id, since when (UTC, ISO 8601), its command line. `?`: unknown.

    host: the name of its computer; empty in older versions.
    """

    pid: str
    since: str
    command: str
    host: str = ""

    @classmethod
    def this_process(cls) -> Self:
        """The calling process, since now."""
        command = " ".join(shlex.join(sys.orig_argv).split())
        return cls(str(os.getpid()), calendar_time(), command, socket.gethostname())

    @classmethod
    def read(cls, text: str) -> Self:
        """From the text of a lock file; older versions of cellctl wrote only its first line, or three."""
        pid, since, command, host = [*text.split("\n"), "", "", ""][:4]
        return cls(pid or "?", since or "?", command or "?", host)

    def text(self) -> str:
        """For the lock file."""
        return "".join(f"{line}\n" for line in (self.pid, self.since, self.command, self.host))

    def error(self, run_folder: Path) -> JournalError:
        """Error message for another process that tries to write the run in `run_folder`."""
        cure = f"wait for its end, or end it (kill {self.pid}: it cleans up and ends); then try again"
        what = f"process {self.pid} writes this run, since {self.since}: {self.command}"
        return JournalError(run_folder, what, cure)


@final
class WriterLock:
    """The right to write one journal, held until `release`."""

    def __init__(self, file: LockedFile) -> None:
        self._file = file

    @classmethod
    def take(cls, path: Path) -> Self:
        """Lock `path`; creates the file if it is missing.

        Raises JournalError if another process holds it or the system has no such locks; OSError.
        """
        if not HAS_LOCKS:
            raise JournalError(path.parent, "a run cannot be written on this system", "run it on Linux")
        try:
            return cls(LockedFile.take(path, Writer.this_process().text()))
        except LockedByOther as held:
            raise Writer.read(held.text).error(path.parent) from None

    def release(self) -> None:
        """Release the lock; a second call has no effect."""
        self._file.release()


def lock_holder(path: Path) -> Writer | None:
    """The process that holds the lock at `path` now, else None."""
    text = locked_text(path)
    return None if text is None else Writer.read(text)
