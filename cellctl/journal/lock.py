"""One writer for a run: a lock that the kernel releases whenever its holder ends.

Writing needs POSIX locks. Reading and finding the writer work without them: on such systems no process writes.
"""

from __future__ import annotations

import io
import os
import shlex
import sys
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Self, final

from cellctl.clock import calendar_time
from cellctl.journal.errors import JournalError

try:
    import fcntl
except ImportError:  # Windows: runs can only be read there
    HAS_LOCKS = False
else:
    HAS_LOCKS = True

_ASKED_S, _ATTEMPTS = 0.3, 30
"""A process that asks who writes (`lock_holder`) holds a free lock for a moment: wall time to wait for its end, s."""

_LONGEST = 4096
"""Number of bytes read from a lock file: more than a process writes to it."""


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

    def __init__(self, stream: io.FileIO) -> None:
        self._stream = stream

    @classmethod
    def take(cls, path: Path) -> Self:
        """Lock `path`; creates the file if it is missing.

        Raises JournalError if another process holds it or the system has no such locks; OSError.
        """
        if not HAS_LOCKS:
            raise JournalError(path.parent, "a run cannot be written on this system", "run it on Linux")
        stream = io.FileIO(path, "a+")
        try:
            _lock(stream)
            stream.truncate(0)
            stream.write(Writer.this_process().text().encode(errors="replace"))
        except BlockingIOError:
            writer = _written_in(stream)
            stream.close()
            raise writer.error(path.parent) from None
        except OSError:
            stream.close()
            raise
        return cls(stream)

    def release(self) -> None:
        """Release the lock; a second call has no effect."""
        self._stream.close()


def _lock(stream: io.FileIO) -> None:
    """Lock `stream` for writing. Raises BlockingIOError if another process holds it for longer than `_ASKED_S`."""
    for _ in range(_ATTEMPTS - 1):
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            threading.Event().wait(_ASKED_S / _ATTEMPTS)
        else:
            return
    fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)


def lock_holder(path: Path) -> Writer | None:
    """The process that holds the lock at `path` now, else None."""
    if not HAS_LOCKS:
        return None
    try:
        with io.FileIO(path) as stream:
            try:
                fcntl.flock(stream, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except BlockingIOError:
                return _written_in(stream)
    except OSError:
        return None
    return None


def _written_in(stream: io.FileIO) -> Writer:
    return Writer.read(os.pread(stream.fileno(), _LONGEST, 0).decode(errors="replace").removesuffix("\n"))
