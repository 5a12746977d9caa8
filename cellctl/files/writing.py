"""Writing files: canonical JSON, atomic writes of whole files, and lines appended by several processes."""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import os
import secrets
from pathlib import Path
from typing import Any


def canonical_json(value: Any) -> str:
    """JSON of `value` with sorted keys, no spaces and shortest round-trip numbers; NaN and infinities are refused.

    Raises ValueError for a number that JSON cannot hold, TypeError for a type that it cannot.
    """
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


def sha256_of(value: Any) -> str:
    """SHA-256 (hex) of `value`: of a string's or bytes' own content, of anything else's canonical JSON."""
    if not isinstance(value, bytes):
        value = (value if isinstance(value, str) else canonical_json(value)).encode()
    return hashlib.sha256(value).hexdigest()


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


def append_line(path: Path, line: str) -> None:
    """Append `line` to the file `path` and make it durable; the file is made if it is missing. Needs POSIX locks.

    A part of a line that a crash left at the end stays a line of its own. Raises OSError (full disk, no
    permission); the file is then as it was.
    """
    import fcntl  # POSIX alone

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
