"""One writer for a run: a lock that the kernel releases whenever its holder ends.

Writing needs POSIX locks. Reading and finding the writer work without them: on such systems no process writes.
"""

from __future__ import annotations

import os
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Self, final

from cellctl.clock import calendar_time
from cellctl.files.locked import HAS_LOCKS, LockedByOther, LockedFile, locked_text
from cellctl.journal.errors import JournalError


@final
@dataclass(frozen=True, slots=True)
class Writer:
    """The process that writes a run: its id, since when (UTC, ISO 8601), its command line. `?`: unknown."""

    pid: str
    since: str
    command: str

    @classmethod
    def this_process(cls) -> Self:
        """The calling process, since now."""
        return cls(str(os.getpid()), calendar_time(), " ".join(shlex.join(sys.orig_argv).split()))

    @classmethod
    def read(cls, text: str) -> Self:
        """From the text of a lock file; older versions of cellctl wrote only its first line."""
        lines = [line or "?" for line in text.split("\n")]
        return cls(*[*lines, "?", "?"][:3])

    def text(self) -> str:
        """For the lock file."""
        return "".join(f"{line}\n" for line in (self.pid, self.since, self.command))

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
