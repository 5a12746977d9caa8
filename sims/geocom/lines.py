"""GeoCOM's lines, protocols.md 2.2.

Requests: `%R1Q,RPC[,TrId[,CRC]]:P0,P1…`. Replies: `%R1P,RC_COM,TrId[,CRC]:RC,P0,P1…`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import final

TERMINATOR = b"\r\n"
LONGEST = 512
"""Characters that the receive buffer holds, requests that wait included."""

MOST_RPC = 65_535

_REQUEST = re.compile(r"%R1Q,([0-9]{1,5})(?:,([0-9]{1,10}))?(?:,([0-9]{1,5}))?:(.*)")
_PARAMETER = re.compile(r'\s*("(?:[^"\\]|\\.)*"|\'[^\']*\'|[^,"\']*)\s*(,|$)')
_ESCAPE = re.compile(r"\\(x[0-9A-Fa-f]{2}|.)")

Value = int | float | str | bool


class WrongFormat(ValueError):
    """The line is no request."""


class WrongChecksum(ValueError):
    """The checksum is not that of the line."""


@final
@dataclass(frozen=True, slots=True)
class Request:
    """A request of the host. parameters: as written. transaction: its TrId, 0 without one. checked: it had a CRC."""

    rpc: int
    parameters: tuple[str, ...]
    transaction: int = 0
    checked: bool = False


def crc16(data: bytes) -> int:
    """CRC-16/ARC (polynomial 0xA001 reflected, initial value 0); 0xBB3D of b"123456789"."""
    crc = 0
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ (0xA001 if crc & 1 else 0)
    return crc


def parse_request(line: bytes) -> Request:
    """A line without its end. Raises WrongFormat, WrongChecksum."""
    found = _REQUEST.fullmatch(line.decode("latin-1"))
    if found is None or int(found[1]) > MOST_RPC:
        raise WrongFormat
    rpc, transaction, check, text = found.groups()
    if check is not None and int(check) != crc16(f"%R1Q,{rpc},{transaction}:{text}".encode("latin-1")):
        raise WrongChecksum
    return Request(int(rpc), _split(text), int(transaction or 0), check is not None)


def _split(text: str) -> tuple[str, ...]:
    """The parameters of a request; commas within quotes are part of them. Raises WrongFormat."""
    if not text:
        return ()
    found: list[str] = []
    place = 0
    while True:
        part = _PARAMETER.match(text, place)
        if part is None:
            raise WrongFormat
        found.append(part[1].strip())
        place = part.end()
        if not part[2]:
            return tuple(found)


def reply(transaction: int, parts: Iterable[str], *, com: int = 0, checked: bool = False) -> bytes:
    """A reply with its end. com: RC_COM; parts: RC and the values, as written."""
    tail = ",".join(parts)
    head = f"%R1P,{com},{transaction}"
    if checked:
        head += f",{crc16(f'{head}:{tail}'.encode('ascii'))}"
    return f"{head}:{tail}".encode("ascii") + TERMINATOR


def written(value: Value, digits: int) -> str:
    """A value as the instrument writes it; `digits`: decimals of a double."""
    if isinstance(value, str):
        return f'"{"".join(map(_escaped, value))}"'
    if isinstance(value, float):
        return f"{value:.{digits}f}"
    return str(int(value))


def _escaped(character: str) -> str:
    if character in '"\\~%':
        return f"\\{character}"
    return character if " " <= character <= "~" else f"\\x{ord(character):02X}"


def read_whole(text: str) -> int:
    """An integer, `12` or `0xC`. Raises ValueError."""
    return int(text, 16 if text.lower().startswith("0x") else 10)


def read_double(text: str) -> float:
    """A finite double. Raises ValueError."""
    value = float(text)
    if value != value or value in (float("inf"), float("-inf")):
        raise ValueError(text)
    return value


def read_string(text: str) -> str:
    """A string in quotes. Raises ValueError."""
    if len(text) < 2 or text[0] != '"' or text[-1] != '"':
        raise ValueError(text)
    return _ESCAPE.sub(lambda found: chr(int(found[1][1:], 16)) if len(found[1]) == 3 else found[1], text[1:-1])
