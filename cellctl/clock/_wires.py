"""Counts the bytes that a driver reads and writes, so that a simulated cell's time waits for them."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Protocol, final


class Wire(Protocol):
    """Byte counts of one device's wire since it was opened. Safe from any thread; never blocks."""

    def wrote(self, count: int) -> None:
        """Add this number of bytes passed to the operating system."""

    def read(self, count: int) -> None:
        """Add this number of bytes read; their receiver was called or is scheduled on the loop."""

    def close(self) -> None:
        """The wire is closed: no more reads or writes."""


@final
class UncountedWire:
    """The wire of a real device, or of a simulated one in real time: counts nothing."""

    def wrote(self, count: int) -> None:
        """Nothing."""

    def read(self, count: int) -> None:
        """Nothing."""

    def close(self) -> None:
        """Nothing."""


@final
class CountedWire:
    """The wire of a device of a cell in lockstep, opened when the cell had written `before` bytes to it.

    `written`: bytes since then; `bytes_read`: of all that the cell has written. `on_change` is called, from any thread,
    when something was read or the wire closed.
    """

    def __init__(self, before: int, on_change: Callable[[], object]) -> None:
        self.written = 0
        self.bytes_read = before
        self._closed = False
        self._on_change = on_change
        self._counting = threading.Lock()

    def wrote(self, count: int) -> None:
        """Add this number of bytes passed to the operating system."""
        with self._counting:
            self.written += count

    def read(self, count: int) -> None:
        """Add this number of bytes read."""
        with self._counting:
            self.bytes_read += count
        self._on_change()

    def catch_up(self, written_by_cell: int) -> None:
        """Count what the cell has written so far as read: what is missing was lost."""
        with self._counting:
            self.bytes_read = max(self.bytes_read, written_by_cell)

    def close(self) -> None:
        """Stop waiting for unread bytes of the cell."""
        self._closed = True
        self.written = 0
        self._on_change()

    def has_read(self, written_by_cell: int) -> bool:
        """Whether all that the cell has written so far has been read."""
        return self._closed or self.bytes_read >= written_by_cell
