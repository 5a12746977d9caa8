"""Atomic writes: after any interruption a file is either the complete old or the complete new one."""

from __future__ import annotations

import contextlib
import os
import secrets
from pathlib import Path

LINKS = 40
"""Maximum number of links followed in a chain, as in the kernel."""


def write_atomically(path: Path, content: str | bytes) -> None:
    """Write `content` (text as UTF-8) to `path` so that no reader or crash leaves a partial file.

    A link is followed. A file that is replaced keeps its permissions, a new one has those that the umask leaves. A
    stream (`is_stream`) is written directly. Raises OSError (full disk, no permission), with
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
    """Whether `path` is an appending stream: a device, a FIFO, or a file that a process
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
    if hasattr(os, "O_DIRECTORY"):  # other systems (Windows) cannot open a folder
        with contextlib.suppress(OSError):  # the file exists; not every file system can sync its name
            _settle(path.parent)


def _settle(folder: Path) -> None:
    directory = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(directory)
    finally:
        os.close(directory)
