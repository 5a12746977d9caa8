"""Reads the cell's time in any process of this host, from a source text short enough for a command line."""

from __future__ import annotations

import mmap
import time
from collections.abc import Callable
from pathlib import Path

TimeReader = Callable[[], int]
"""Gives the cell's time in nanoseconds; safe to call from any thread."""


def reader_of(source: str) -> TimeReader:
    """A reader for `source`.

    `wall:EPOCH`: CLOCK_MONOTONIC minus EPOCH nanoseconds, the same in every process of a host.
    `file:PATH`: the 8-byte little-endian integer that a simulated cell keeps up to date in a memory-mapped file.

    Raises ValueError for another kind of source, OSError if the file cannot be mapped.
    """
    kind, _, value = source.partition(":")
    if kind == "wall":
        epoch = int(value)
        return lambda: time.monotonic_ns() - epoch
    if kind == "file":
        return _mapped(Path(value))
    raise ValueError(f"no clock source of kind '{kind}' (in '{source}')")


def _mapped(path: Path) -> TimeReader:
    with path.open("rb") as stream:
        try:
            view = memoryview(mmap.mmap(stream.fileno(), 8, access=mmap.ACCESS_READ)).cast("q")
        except ValueError as error:
            raise OSError(f"{path} is no time file: {error}") from error
    return lambda: view[0]
