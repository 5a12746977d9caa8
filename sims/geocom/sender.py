"""Instrument → host: replies one after another, and what can happen to them on the way."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import final

from sims.faults import Faults
from sims.kernel import Kernel
from sims.terminal import wire_time_ns


@final
class Sender:
    """Writes a line when its last character has come over the line.

    Faults: missing, late, doubled, garbled. `write` gives a line to the host.
    """

    def __init__(self, kernel: Kernel, faults: Faults, baud: int, write: Callable[[bytes], object]) -> None:
        self._kernel = kernel
        self._faults = faults
        self._baud = baud
        self._write = write
        self._free_at = 0
        self._session = 0
        self._lines = 0

    def send(self, line: bytes, delay_ns: int = 0) -> None:
        """Send a line, `delay_ns` from now on at the earliest."""
        if self._faults.active("tracker.missing"):
            return
        late = self._faults.active("tracker.late")
        begin = self._kernel.now + delay_ns + (round(late.settings["by_ms"] * 1e6) if late else 0)
        for _ in range(2 if self._faults.active("tracker.doubled") else 1):
            end = max(self._free_at, begin) + wire_time_ns(len(line), self._baud)
            self._free_at = end
            self._kernel.at(end, partial(self._deliver, self._damaged(line), self._session))

    def cut(self) -> None:
        """The host has hung up: what is not out is lost."""
        self._session += 1
        self._free_at = 0

    def _deliver(self, line: bytes, session: int) -> None:
        if session == self._session:
            self._write(line)

    def _damaged(self, line: bytes) -> bytes:
        """The line; while the fault is active, each n-th with one bit of its middle character turned over."""
        fault = self._faults.active("tracker.garbled")
        if fault is None:
            return line
        self._lines = (self._lines + 1) % fault.settings["every"]
        middle = len(line) // 2
        return line if self._lines else line[:middle] + bytes([line[middle] ^ 1]) + line[middle + 1 :]
