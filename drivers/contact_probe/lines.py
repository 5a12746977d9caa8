"""The line format: check sum, framing, parsing, printing. Pure; no port, no clock."""

from __future__ import annotations

import binascii
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import final

from drivers.contact_probe.messages import (
    Boot,
    Confirmation,
    Edge,
    Fault,
    Heartbeat,
    Introduction,
    Message,
    Opened,
    Reply,
    Synced,
)

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
