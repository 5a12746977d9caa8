"""Standard output and error for long work: their failures do not end it."""

from __future__ import annotations

import io
import os
import sys
from typing import TYPE_CHECKING, TextIO, final

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer


def prepare() -> None:
    """Set up `sys.stdout` and `sys.stderr` of this process.

    Output to a closed stream, or to one whose reader has ended (`| head`), is discarded.
    Letters outside the terminal's encoding become `\\u03c3`. Other failures of stdout (full disk) raise an
    OSError of the file `stdout`; failures of stderr are ignored.
    """
    for number in range(3):
        _open_if_closed(number)
    sys.stdout, sys.stderr = _text(_Stream(1, "stdout"), sys.stdout), _text(_Stream(2, None), sys.stderr)


@final
class _Stream(io.FileIO):
    """Descriptor `number`; after the first failure, output to it is dropped. name: in errors; None: none."""

    def __init__(self, number: int, name: str | None) -> None:
        super().__init__(number, "w", closefd=False)
        self._name = name

    def write(self, data: ReadableBuffer, /) -> int:
        try:
            return super().write(data)
        except OSError as error:
            os.dup2(os.open(os.devnull, os.O_WRONLY), self.fileno())
            if self._name is None or isinstance(error, BrokenPipeError):
                return memoryview(data).nbytes
            raise OSError(error.errno, os.strerror(error.errno or 0), self._name) from error


def _open_if_closed(number: int) -> None:
    """The next opened file would get a closed descriptor, and messages would be written into it."""
    try:
        os.fstat(number)
    except OSError:
        os.dup2(os.open(os.devnull, os.O_RDWR), number)


def _text(raw: _Stream, before: TextIO | None) -> TextIO:
    encoding = before.encoding if before else "utf-8"
    by_line = raw.isatty() or raw.fileno() == 2
    return io.TextIOWrapper(
        io.BufferedWriter(raw), encoding=encoding, errors="backslashreplace", line_buffering=by_line
    )
