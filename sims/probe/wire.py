"""The serial line: characters one after another, and a USB adapter that is asked now and then."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import partial
from typing import final

from sims.kernel import Event, Kernel
from sims.probe.lines import LineCutter, framed
from sims.probe.outbox import Message
from sims.terminal import wire_time_ns


def next_poll_ns(time_ns: int, grid_ns: int) -> int:
    """The first multiple of the grid at or after `time_ns`; a grid of 0 has no polls to wait for."""
    return time_ns if grid_ns == 0 else -(-time_ns // grid_ns) * grid_ns


@final
class Transmitter:
    """Probe → host. A line gets its tick when its first character goes out, and arrives at the USB poll after its last.

    `deliver(line, seq)` is called on arrival.
    """

    def __init__(
        self, kernel: Kernel, baud: int, grid_ns: int, tick: Callable[[], int], deliver: Callable[[bytes, int], object]
    ) -> None:
        self._kernel = kernel
        self._baud = baud
        self._grid_ns = grid_ns
        self._tick = tick
        self._deliver = deliver
        self._queue: deque[Message] = deque()
        self._sending: Event | None = None

    def send(self, message: Message) -> None:
        """Put a line behind those that wait; one that waits already is not doubled."""
        if message not in self._queue:
            self._queue.append(message)
        if self._sending is None:
            self._begin()

    def cut(self) -> None:
        """The probe has lost its power: what is not out is lost."""
        self._queue.clear()
        if self._sending is not None:
            self._sending.cancel()
            self._sending = None

    def _begin(self) -> None:
        if not self._queue:
            self._sending = None
            return
        message = self._queue.popleft()
        line = framed(message.body(self._tick()))
        self._sending = self._kernel.after(wire_time_ns(len(line), self._baud), lambda: self._sent(line, message.seq))

    def _sent(self, line: bytes, seq: int) -> None:
        self._kernel.at(next_poll_ns(self._kernel.now, self._grid_ns), lambda: self._deliver(line, seq))
        self._begin()


@final
class Receiver:
    r"""Host → probe. `understand(line)` is called once a line's last character has come over the wire, without `\n`."""

    def __init__(self, kernel: Kernel, baud: int, understand: Callable[[bytes], object]) -> None:
        self._kernel = kernel
        self._baud = baud
        self._understand = understand
        self._cutter = LineCutter()
        self._free_at = 0

    def feed(self, chunk: bytes) -> list[bytes]:
        """Characters that the host has put into its adapter now. Returns the lines that they complete."""
        start = max(self._free_at, self._kernel.now)
        self._free_at = start + wire_time_ns(len(chunk), self._baud)
        lines = self._cutter.feed(chunk)
        for line, count in lines:
            self._kernel.at(start + wire_time_ns(count, self._baud), partial(self._understand, line))
        return [line for line, _ in lines]
