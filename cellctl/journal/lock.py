"""One writer for a run: a lock that the kernel drops when its holder dies, however it dies."""

from __future__ import annotations

import fcntl
import io
import os
from pathlib import Path
from typing import Self, final

from cellctl.journal.errors import JournalError


@final
class WriterLock:
    """The right to write one journal. Held from taking it until `release`."""

    def __init__(self, stream: io.FileIO) -> None:
        self._stream = stream

    @classmethod
    def take(cls, path: Path) -> Self:
        """Lock `path`, which is made if need be. Raises JournalError where somebody holds it, OSError."""
        stream = io.FileIO(path, "a+")
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            stream.truncate(0)
            stream.write(f"{os.getpid()}\n".encode())
        except BlockingIOError:
            holder = os.pread(stream.fileno(), 32, 0).decode(errors="replace").strip() or "?"
            stream.close()
            cure = "wait for its end, or end it; then try again"
            raise JournalError(path.parent, f"process {holder} writes this run", cure) from None
        except OSError:
            stream.close()
            raise
        return cls(stream)

    def release(self) -> None:
        """Let go of it; doing so twice does no harm."""
        self._stream.close()


def is_locked(path: Path) -> bool:
    """Whether somebody holds the lock at `path` now."""
    try:
        with io.FileIO(path) as stream:
            fcntl.flock(stream, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False
