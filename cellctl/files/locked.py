"""Files that one process locks, with a text that tells the others who it is. The kernel releases the lock at its end.

Taking a lock needs POSIX locks; on other systems nothing is locked.
"""

from __future__ import annotations

import io
import os
import threading
from contextlib import suppress
from pathlib import Path
from typing import Self, final

try:
    import fcntl
except ImportError:  # Windows
    HAS_LOCKS = False
else:
    HAS_LOCKS = True

_ASKED_S, _ATTEMPTS = 0.3, 30
"""A process that asks who holds a free lock (`locked_text`) holds it for a moment: wall time to wait for its end, s."""

_LONGEST = 4096
"""Number of bytes read from a lock file: more than a process writes to it."""


@final
class LockedByOther(Exception):
    """Another process holds the lock. `text`: what it wrote into the file."""

    def __init__(self, text: str) -> None:
        self.text = text
        super().__init__(text)


@final
class LockedFile:
    """A file that this process has locked, until `release`."""

    def __init__(self, stream: io.FileIO) -> None:
        self._stream = stream

    @classmethod
    def take(cls, path: Path, text: str, *, every_user: bool = False) -> Self:
        """Lock `path` and write `text` into it. A missing file is made; every_user: so that all users can lock it.

        Raises LockedByOther if it is locked, by this process too; OSError.
        """
        stream = io.FileIO(_opened(path, every_user), "r+")
        try:
            _lock(stream)
            stream.truncate(0)
            stream.write(text.encode(errors="replace"))
        except BlockingIOError:
            held = _text_in(stream)
            stream.close()
            raise LockedByOther(held) from None
        except OSError:
            stream.close()
            raise
        return cls(stream)

    def release(self) -> None:
        """Release the lock; a second call has no effect."""
        self._stream.close()


def locked_text(path: Path) -> str | None:
    """What the process that holds the lock at `path` now wrote into it; None: it is free, or cannot be read."""
    if not HAS_LOCKS:
        return None
    try:
        with io.FileIO(path) as stream:
            try:
                fcntl.flock(stream, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except BlockingIOError:
                return _text_in(stream)
    except OSError:
        return None
    return None


def _opened(path: Path, every_user: bool) -> int:
    """A descriptor of `path`. Without O_CREAT first: Linux refuses that for a file of another user in a folder that
    everybody can write to (fs.protected_regular).
    """
    with suppress(FileNotFoundError):
        return os.open(path, os.O_RDWR)
    found = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
    if every_user:
        os.fchmod(found, 0o666)  # the umask does not count
    return found


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


def _text_in(stream: io.FileIO) -> str:
    return os.pread(stream.fileno(), _LONGEST, 0).decode(errors="replace").removesuffix("\n")
