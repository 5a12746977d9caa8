"""The probe's line protocol: check sum, lines numbered and repeated until acknowledged, characters on the line."""

from __future__ import annotations

import binascii
import re
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import final
from urllib.parse import parse_qsl, urlsplit

from sims.kernel import Event, Kernel
from sims.wires import wire_time_ns

LONGEST = 120
"""Characters of a line, without its end."""

COMMANDS = frozenset({"ACK", "HELLO", "ARM", "DISARM", "SYNC"})
"""The commands of this probe; each has its number and no further field."""

_HOST_LINE = re.compile(rb"([A-Z]+),(0|[1-9][0-9]{0,4})((?:,[^,*]*)*)\*([0-9A-F]{4})")


@final
@dataclass(frozen=True, slots=True)
class HostLine:
    """A valid line of the host, of a type that may be unknown. `seq`: its own number; of ACK, the probe's line's."""

    kind: str
    seq: int


def crc16(data: bytes) -> int:
    """CRC-16/CCITT-FALSE; 0x29B1 of b"123456789"."""
    return binascii.crc_hqx(data, 0xFFFF)


def framed(body: str) -> bytes:
    """A line's body with its check sum and end."""
    data = body.encode("ascii")
    return data + b"*%04X\n" % crc16(data)


def parse_host_line(line: bytes) -> HostLine | None:
    r"""A host's line without its `\n`; None where it is out of form, or its check sum or number of fields is wrong.

    A type that this probe does not know may have any fields.
    """
    match = _HOST_LINE.fullmatch(line.removesuffix(b"\r"))
    if match is None or int(match[4], 16) != crc16(match.string[: match.start(4) - 1]):
        return None
    kind, seq = match[1].decode(), int(match[2])
    if seq > 0xFFFF or (kind in COMMANDS and match[3]):
        return None
    return HostLine(kind, seq)


@final
class LineCutter:
    """Cuts what arrives into lines; one that is too long is dropped whole."""

    def __init__(self) -> None:
        self._begun = b""
        self._overlong = False

    def feed(self, chunk: bytes) -> list[tuple[bytes, int]]:
        r"""The lines that `chunk` completes, without `\n`, and how many of the chunk's characters had come by then."""
        found = []
        position = 0
        while (end := chunk.find(b"\n", position)) >= 0:
            line = self._begun + chunk[position:end]
            if not self._overlong and len(line) <= LONGEST:
                found.append((line, end + 1))
            self._begun, self._overlong, position = b"", False, end + 1
        self._begun += chunk[position:]
        if len(self._begun) > LONGEST:
            self._begun, self._overlong = b"", True
        return found


REPEAT_NS = 50_000_000


@final
@dataclass(frozen=True, slots=True)
class Message:
    """A line to come. Its tick is added when it goes onto the wire."""

    kind: str
    seq: int
    fields: tuple[object, ...]

    def body(self, tick: int) -> str:
        """`TYPE,seq,tick,field,…`"""
        return ",".join(map(str, (self.kind, self.seq, tick, *self.fields)))


@final
class Outbox:
    """Counts the probe's lines and repeats those that the host has not acknowledged."""

    def __init__(self) -> None:
        self._next_seq = 0
        self._ready: list[Message] = []
        self._repeat_at: dict[Message, int] = {}

    def post(self, now: int, kind: str, *fields: object, once: bool = False) -> None:
        """A new line; `once`: not repeated."""
        message = Message(kind, self._next_seq, fields)
        self._next_seq = (self._next_seq + 1) % 0x10000
        self._ready.append(message)
        if not once:
            self._repeat_at[message] = now + REPEAT_NS

    def acknowledge(self, seq: int) -> None:
        """The host has the line of this number."""
        for message in [message for message in self._repeat_at if message.seq == seq]:
            del self._repeat_at[message]

    def collect(self, now: int) -> list[Message]:
        """The new lines since the last time, and those whose repetition is due."""
        for message in [message for message, due in self._repeat_at.items() if due <= now]:
            self._repeat_at[message] = now + REPEAT_NS
            self._ready.append(message)
        ready, self._ready = self._ready, []
        return ready

    @property
    def wake_at(self) -> int | None:
        """When the next repetition is due."""
        return min(self._repeat_at.values(), default=None)


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


ARM, CONTACT = "probe.arm", "probe.contact"
BAUD = 250_000


def baud_of(address: str) -> int:
    """Of the serial line, as the address has it. Raises ValueError where that is no whole number."""
    return int(dict(parse_qsl(urlsplit(address).query)).get("baud", BAUD))
