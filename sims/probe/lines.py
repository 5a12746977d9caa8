"""The line protocol's outer form, from docs/reference/probe-protocol.md: check sum, fields, the cut into lines."""

from __future__ import annotations

import binascii
import re
from dataclasses import dataclass
from typing import final

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
