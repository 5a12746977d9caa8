"""Bytes that a driver reads and writes, counted, so that a simulated cell's time waits for them."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Protocol, final


class Wire(Protocol):
    """What went over one device's wire since it was opened. Safe from any thread; never blocks."""

    def wrote(self, count: int) -> None:
        """So many bytes were given to the operating system."""

    def read(self, count: int) -> None:
        """So many bytes were read, and whoever they concern has been told or is next on the loop."""

    def close(self) -> None:
        """Nothing more will be read or written."""


@final
class UncountedWire:
    """The wire of a real device, or of one in real time: its time waits for nobody."""

    def wrote(self, count: int) -> None:
        """Nothing."""

    def read(self, count: int) -> None:
        """Nothing."""

    def close(self) -> None:
        """Nothing."""


@final
class CountedWire:
    """The wire of a device of a cell in lockstep, opened when the cell had written `before` bytes to it.

    `written`: bytes since then. `on_change` is called, from any thread, when something was read or the wire closed.
    """

    def __init__(self, before: int, on_change: Callable[[], object]) -> None:
        self.written = 0
        self._read = before
        self._closed = False
        self._on_change = on_change
        self._counting = threading.Lock()

    def wrote(self, count: int) -> None:
        """So many bytes were given to the operating system."""
        with self._counting:
            self.written += count

    def read(self, count: int) -> None:
        """So many bytes were read."""
        with self._counting:
            self._read += count
        self._on_change()

    def close(self) -> None:
        """What the cell wrote and nobody has read is awaited no more."""
        self._closed = True
        self.written = 0
        self._on_change()

    def has_read(self, written_by_cell: int) -> bool:
        """Whether all that the cell has written so far has been read."""
        return self._closed or self._read >= written_by_cell
