"""The proxy's messages, bytes in and out: requests cut from a TCP stream, answers put together."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import final

GENERAL, SUCCESS, ACCESS, NOT_IMPLEMENTED, PROTOCOL = 0, 1, 2, 7, 9
"""Error codes of an answer's footer."""


class BadRequest(Exception):
    """A request whose content does not fit its type."""


@final
@dataclass(frozen=True, slots=True)
class Request:
    """`number` as the client counts; `body`: what follows the type."""

    number: int
    kind: int
    body: bytes


@final
class RequestStream:
    """Feed it bytes as they come, take requests out. `broken`: a length of 0, which no message has."""

    def __init__(self) -> None:
        self.broken = False
        self._rest = bytearray()

    def feed(self, data: bytes) -> Iterator[Request]:
        """The requests that `data` completes."""
        self._rest += data
        while len(self._rest) >= 4 and not self.broken:
            number = int.from_bytes(self._rest[:2], "big")
            size = int.from_bytes(self._rest[2:4], "big")
            if size == 0:
                self.broken = True
                return
            if len(self._rest) < 4 + size:
                return
            message = bytes(self._rest[4 : 4 + size])
            del self._rest[: 4 + size]
            yield Request(number, message[0], message[1:])


@final
class Fields:
    """Reads the fields of a request one after the other. Raises BadRequest where the bytes do not suffice."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    def take(self, count: int) -> bytes:
        """The next bytes."""
        found = self._data[self._at : self._at + count]
        if len(found) < count:
            raise BadRequest(f"{count} bytes are expected, {len(found)} are there")
        self._at += count
        return found

    def number(self, size: int) -> int:
        """An unsigned number of so many bytes, most significant first."""
        return int.from_bytes(self.take(size), "big")

    def text(self) -> str:
        """A length of two bytes, and so many characters of one byte."""
        return self.take(self.number(2)).decode("latin-1")

    def wide_text(self) -> str:
        """A length in characters, and UTF-16 with the least significant byte first."""
        return self.take(2 * self.number(2)).decode("utf-16-le", "replace")


def text(value: str) -> bytes:
    """A text as it is sent."""
    data = value.encode("latin-1", "replace")
    return len(data).to_bytes(2, "big") + data


def answer(number: int, kind: int, body: bytes, code: int = SUCCESS) -> bytes:
    """A whole answer; TRUE at its end where it succeeded."""
    message = bytes([kind]) + body + code.to_bytes(2, "big") + bytes([code == SUCCESS])
    return number.to_bytes(2, "big") + len(message).to_bytes(2, "big") + message
