"""Errors of a journal."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from cellctl.files.kinds import JOURNAL, kind_of_file, other_kind

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
