"""Standard output and error as a long piece of work needs them: nothing that happens to them ends it."""

from __future__ import annotations

import io
import os
import sys
from typing import TYPE_CHECKING, TextIO, final

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer


def prepare() -> None:
    """Set up `sys.stdout` and `sys.stderr` of this process.

    A stream that is closed takes everything and keeps nothing, and so does one whose reader has left (`| head`).
    Letters that a terminal does not know become `\\u03c3`. What stdout cannot take otherwise (a full disk) is an
    OSError of the file `stdout`; what stderr cannot take is lost.
    """
    for number in range(3):
        _open_if_closed(number)
    sys.stdout, sys.stderr = _text(_Stream(1, "stdout"), sys.stdout), _text(_Stream(2, None), sys.stderr)


@final
class _Stream(io.FileIO):
    """Descriptor `number`; from the first failure on, what is written to it is dropped. name: in errors; None: none."""

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
    """A closed descriptor would be the next file's that is opened, and words for a person would go into that."""
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
