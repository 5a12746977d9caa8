"""Appending lines to a text file: whole lines only, also from several processes at once and on a full disk."""

from __future__ import annotations

import errno
import os
from pathlib import Path


def append_line(path: Path, line: str) -> None:
    """Append `line` to the file `path` and make it durable; the file is made if it is missing. Needs POSIX locks.

    A part of a line that a crash left at the end stays a line of its own. Raises OSError (full disk, no
    permission); the file is then as it was.
    """
    import fcntl

    with path.open("a+b", buffering=0) as stream:
        fcntl.flock(stream, fcntl.LOCK_EX)  # until the stream is closed
        end = stream.seek(0, os.SEEK_END)
        data = (_line_end(stream.fileno(), end) + line + "\n").encode()
        try:
            if stream.write(data) != len(data):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
            os.fsync(stream.fileno())
        except OSError:
            stream.truncate(end)
            raise


def _line_end(file: int, end: int) -> str:
    """What the last line needs to be complete."""
    os.lseek(file, max(end - 1, 0), os.SEEK_SET)
    return "\n" if end and os.read(file, 1) != b"\n" else ""
