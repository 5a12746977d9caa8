"""A file is either the old one or the new one, whole, whatever happens in between."""

from __future__ import annotations

import contextlib
import os
import secrets
from pathlib import Path

LINKS = 40
"""So many links are followed, one after another, as the kernel does."""


def write_atomically(path: Path, content: str | bytes) -> None:
    """Write `content` (text as UTF-8) to `path` so that a reader, or a crash, never sees half of it.

    A link is followed. A file that is replaced keeps its permissions, a new one has those that the umask leaves. What
    is a stream (`is_stream`) is written to as it is. Raises OSError (full disk, no permission), with
    `path` as its file; the old file is then still in place and no temporary file is left.
    """
    data = content.encode() if isinstance(content, str) else content
    try:
        if is_stream(path):
            with path.open("ab") as stream:
                stream.write(data)
        else:
            _replace(Path(os.path.realpath(path)), data)
    except OSError as error:
        if error.errno is None:
            raise
        raise OSError(error.errno, os.strerror(error.errno), str(path)) from error  # not the temporary file's name


def is_stream(path: Path) -> bool:
    """Whether `path` takes what it is given and adds it to what it had: a device, a FIFO, or a file that some process
    has open under another name (`/dev/stdout`, `/dev/fd/3`).
    """
    if path.exists() and not path.is_file():
        return not path.is_dir()
    for _ in range(LINKS):
        if os.path.realpath(path.parent).startswith("/proc/"):
            return True
        if not path.is_symlink():
            break
        path = path.parent / path.readlink()
    return False


def _replace(path: Path, data: bytes) -> None:
    temporary = path.with_name(f".{path.name[:100]}.{secrets.token_hex(4)}")
    try:
        with temporary.open("xb") as stream:
            if path.exists():
                temporary.chmod(path.stat().st_mode & 0o7777)
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    if hasattr(os, "O_DIRECTORY"):  # elsewhere (Windows) a folder cannot be opened
        with contextlib.suppress(OSError):  # the file is there; not every file system can make sure of its name
            _settle(path.parent)


def _settle(folder: Path) -> None:
    directory = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(directory)
    finally:
        os.close(directory)
