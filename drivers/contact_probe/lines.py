"""The probe's lines: one class for each type, check sum, framing, parsing, printing. Pure; no port, no clock."""

from __future__ import annotations

import binascii
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import final

_CLOSED_BELOW_MV = 500
_OPEN_MV = range(1400, 2501)
"""States of the loop, as in docs/reference/probe-protocol.md."""


@final
@dataclass(frozen=True, slots=True)
class Boot:
    """`BOOT`: the probe has started; `cause` is `POWER`, `EXTERNAL`, `BROWNOUT` or `WATCHDOG`."""

    proto: int
    cause: str


@final
@dataclass(frozen=True, slots=True)
class Introduction:
    """`ID`: the probe's identity; its hardware count runs at `tick_hz`."""

    host_seq: int
    proto: int
    firmware: str
    name: str
    serial: str
    tick_hz: int
    cause: str


@final
@dataclass(frozen=True, slots=True)
class Heartbeat:
    """`HB`, every 50 ms: the state (`DISARMED`, `ARMED`, `TRIPPED`, `FAULT`) and the loop's voltage in mV."""

    state: str
    loop_mv: int
    host_ok: int

    @property
    def closed(self) -> bool:
        """Whether the loop is closed."""
        return self.loop_mv < _CLOSED_BELOW_MV

    @property
    def open(self) -> bool:
        """Whether the loop is open and whole. Neither closed nor open: broken, or an undefined voltage."""
        return self.loop_mv in _OPEN_MV


@final
@dataclass(frozen=True, slots=True)
class Edge:
    """`EDGE`: the first edge to *closed* while armed, at the hardware count `edge_tick`."""

    edge_tick: int


@final
@dataclass(frozen=True, slots=True)
class Confirmation:
    """`CONF`: whether the level held for 2 ms after that edge (1 or 0), and the number of further edges."""

    edge_tick: int
    confirmed: int
    bounces: int


@final
@dataclass(frozen=True, slots=True)
class Opened:
    """`OPEN`: the loop has been open for 20 ms after a contact."""

    edge_tick: int


@final
@dataclass(frozen=True, slots=True)
class Fault:
    """`FAULT`: `WIRE`, `STUCK`, `RANGE` or `HOST`."""

    code: str


@final
@dataclass(frozen=True, slots=True)
class Synced:
    """`SYNC`: the answer to a SYNC that was received by the hardware count `received_tick`."""

    host_seq: int
    received_tick: int


@final
@dataclass(frozen=True, slots=True)
class Reply:
    """`RE`: the answer to ARM and DISARM: `OK`, `CLOSED`, `WIRE`, `STATE` or `UNKNOWN`."""

    host_seq: int
    code: str


Answer = Introduction | Synced | Reply
"""The answer to the command `host_seq`."""

Message = Boot | Heartbeat | Edge | Confirmation | Opened | Fault | Answer


LONGEST = 120
"""Characters of a line at most, its end not counted."""

_WHOLE = re.compile(rb"([\x20-\x7e]*)\*([0-9A-F]{4})")
_NUMBER = re.compile(r"[0-9]{1,10}")


class LineError(ValueError):
    """A line that cannot be used: its form, check sum, type, number of fields or a number in it is wrong."""


@final
@dataclass(frozen=True, slots=True)
class Line:
    """A valid line: its number 0…65535, the probe's 32-bit count at the start of sending, and its content."""

    seq: int
    tick: int
    message: Message


def check_sum(body: bytes) -> int:
    """CRC-16/CCITT-FALSE of `body`: polynomial 1021, start FFFF, not reflected."""
    return binascii.crc_hqx(body, 0xFFFF)


def encode(kind: str, seq: int) -> bytes:
    """A line to the probe, `ACK,17*xxxx\\n`."""
    body = f"{kind},{seq}".encode("ascii")
    return b"%s*%04X\n" % (body, check_sum(body))


def parse_line(raw: bytes) -> Line:
    """Read a line of the probe, with or without its end. Raises LineError; never anything else."""
    whole = _WHOLE.fullmatch(raw.removesuffix(b"\n").removesuffix(b"\r"))
    if not whole or len(whole[0]) > LONGEST:
        raise LineError("not a line of the probe")
    if check_sum(whole[1]) != int(whole[2], 16):
        raise LineError("wrong check sum")
    kind, *fields = whole[1].decode("ascii").split(",")
    if kind not in _KINDS or len(fields) != 2 + len(_KINDS[kind][1]):
        raise LineError(f"'{kind}' with {len(fields)} fields is not known")
    build, readers = _KINDS[kind]
    values = [read(field) for read, field in zip(readers, fields[2:], strict=True)]
    return Line(_number_to(0xFFFF)(fields[0]), _tick(fields[1]), build(*values))


@final
class Splitter:
    """Splits the port's bytes into lines; an overlong one is truncated, and is therefore found invalid."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> Iterator[bytes]:
        """The lines that `data` completes, each with its end."""
        *whole, rest = (self._rest + data).split(b"\n")
        self._rest = rest[: LONGEST + 2]
        return (line + b"\n" for line in whole)


def _number_to(highest: int) -> Callable[[str], int]:
    def read(text: str) -> int:
        if not _NUMBER.fullmatch(text) or int(text) > highest:
            raise LineError(f"'{text}' is no number from 0 to {highest}")
        return int(text)

    return read


_tick = _count = _number_to(0xFFFF_FFFF)
_seq = _number_to(0xFFFF)
_flag = _number_to(1)

_KINDS: dict[str, tuple[Callable[..., Message], tuple[Callable[[str], int | str], ...]]] = {
    "BOOT": (Boot, (_count, str)),
    "ID": (Introduction, (_seq, _count, str, str, str, _count, str)),
    "HB": (Heartbeat, (str, _count, _flag)),
    "EDGE": (Edge, (_tick,)),
    "CONF": (Confirmation, (_tick, _flag, _count)),
    "OPEN": (Opened, (_tick,)),
    "FAULT": (Fault, (str,)),
    "SYNC": (Synced, (_seq, _tick)),
    "RE": (Reply, (_seq, str)),
}
