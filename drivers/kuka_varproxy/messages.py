"""Messages of the variable proxy: requests written, answers split from the stream and read.

Source: C3 Bridge Interface Protocol 1.5, sections 3.1, 3.2, 3.5, 3.9; KUKAVARPROXY has the first two types alone.
Integers are big-endian. The length counts the bytes behind it. An answer ends with an error code and a success flag.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import final

LARGEST_MESSAGE = 0xFFFF
"""What the length field can state, bytes."""

_HEADER = struct.Struct(">HHB")
_FOOTER = struct.Struct(">HB")
_LENGTHS = struct.Struct(">HH")
_TEXT = struct.Struct(">H")
_LEAST = 1 + _FOOTER.size


@final
class Kind(IntEnum):
    """Message types that this driver sends."""

    READ = 0
    WRITE = 1
    FILE_WRITE = 29
    FILE_READ = 30


@final
@dataclass(frozen=True, slots=True)
class Answer:
    """An answer: `payload` is what is between type and footer; `code` and `ok` are the footer."""

    id: int
    kind: int
    payload: bytes
    code: int
    ok: bool

    @property
    def text(self) -> str:
        """The payload as one text with its length before it. Raises ValueError if it is not one."""
        if len(self.payload) < _TEXT.size:
            raise ValueError("the answer has no text")
        (length,) = _TEXT.unpack_from(self.payload)
        if len(self.payload) != _TEXT.size + length:
            raise ValueError(f"a text of {length} bytes is announced, {len(self.payload) - _TEXT.size} came")
        return self.payload[_TEXT.size :].decode("latin-1")


def request(number: int, kind: Kind, payload: bytes) -> bytes:
    """A request. Raises ValueError if it is longer than the length field can state."""
    length = 1 + len(payload)
    if length > LARGEST_MESSAGE:
        raise ValueError(f"a message of {length} bytes; {LARGEST_MESSAGE} fit")
    return _HEADER.pack(number, length, kind) + payload


def text_field(text: str) -> bytes:
    """A text with its length before it. Raises ValueError for a character that KRL does not have."""
    try:
        data = text.encode("ascii")
    except UnicodeEncodeError:
        raise ValueError(f"'{text}' has characters that are not ASCII") from None
    return _TEXT.pack(len(data)) + data


def wide_field(text: str) -> bytes:
    """A text in UTF-16, little-endian as the one exception; its length before it counts characters."""
    data = text.encode("utf-16-le")
    return _TEXT.pack(len(data) // 2) + data


@final
class AnswerStream:
    """Splits a stream into answers, for any TCP segmentation."""

    def __init__(self) -> None:
        self._buffer = b""

    def feed(self, data: bytes) -> list[Answer]:
        """The answers that `data` completes. Raises ValueError if an announced length cannot be one of an answer."""
        self._buffer += data
        answers = []
        while len(self._buffer) >= _LENGTHS.size:
            number, length = _LENGTHS.unpack_from(self._buffer)
            if length < _LEAST:
                raise ValueError(f"an answer of {length} bytes is announced; the shortest has {_LEAST}")
            end = _LENGTHS.size + length
            if len(self._buffer) < end:
                break
            body = self._buffer[_LENGTHS.size : end]
            code, ok = _FOOTER.unpack(body[-_FOOTER.size :])
            answers.append(Answer(number, body[0], body[1 : -_FOOTER.size], code, bool(ok)))
            self._buffer = self._buffer[end:]
        return answers
