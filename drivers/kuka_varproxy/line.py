"""The connection to the proxy: its place, its messages, one request after the other, answers matched by number.

Source: C3 Bridge Interface Protocol 1.5, sections 3.1, 3.2, 3.5, 3.9; KUKAVARPROXY has the first two types alone.
Integers are big-endian. The length counts the bytes behind it. An answer ends with an error code and a success flag.
"""

from __future__ import annotations

import asyncio
import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import Self, final

from cellctl.clock import Clock, Wire
from cellctl.devices import Address, DeviceLost, impossible_host
from drivers.tcp_connection import connected, hang_up

PORT = 7000
EXAMPLE = "kuka+varproxy://172.31.1.147:7000"

LARGEST_MESSAGE = 0xFFFF
"""What the length field can state, bytes."""

_HEADER = struct.Struct(">HHB")
_FOOTER = struct.Struct(">HB")
_LENGTHS = struct.Struct(">HH")
_TEXT = struct.Struct(">H")
_LEAST = 1 + _FOOTER.size

UNKNOWN, NOT_IMPLEMENTED = -1, 7
"""Type and code of the answer of length 0 that KUKAVARPROXY gives to a type that it does not know."""

ANSWER_S = 5.0
"""Longest wait for an answer, in the cell's time. A variable takes several ms."""

_CHUNK = 65536
_LAST_NUMBER = 0xFFFF
_CURE = (
    "Make sure that the robot stands. Then look at the network, at the proxy's window on the controller, and at what "
    "else talks to it."
)


@final
@dataclass(frozen=True, slots=True)
class ProxyPlace:
    """Host and port of the proxy on the controller's KLI network."""

    host: str
    port: int

    @classmethod
    def of(cls, address: Address) -> Self:
        """The place in an address. Raises ValueError for a missing host, a path, or a setting: there are none."""
        if not address.host or address.path.strip("/") or address.query:
            raise ValueError(f"'{address}' has to name a host, may name a port, and nothing else, as {EXAMPLE}")
        if why := impossible_host(address.host, reached=True):
            raise ValueError(f"'{address}': {why}")
        return cls(address.host, address.port or PORT)


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
            if length == 0:
                answers.append(Answer(number, UNKNOWN, b"", NOT_IMPLEMENTED, ok=False))
                self._buffer = self._buffer[_LENGTHS.size :]
                continue
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


@final
class ProxyLine:
    """One connection. It is given up at the first answer that is late, unreadable, or to another request.

    `latency_s`: from the last request to its answer, in the cell's time.
    """

    def __init__(self, device: str, place: tuple[str, int], clock: Clock) -> None:
        self.latency_s = 0.0
        self._device = device
        self._place = place
        self._clock = clock
        self._number = 0
        self._pending: dict[int, tuple[Kind, asyncio.Future[Answer]]] = {}
        self._writer: asyncio.StreamWriter | None = None
        self._wire: Wire | None = None
        self._reading: asyncio.Task[None] | None = None
        self._lost: DeviceLost | None = None

    async def open(self) -> None:
        """Connect. Raises DeviceUnreachable."""
        cure = "Is the proxy started on the controller, and is its port released in the NAT of the KLI network?"
        reader, self._writer, self._wire = await connected(
            self._device, self._place, self._clock, peer="variable proxy", cure=cure
        )
        self._reading = asyncio.create_task(self._read(reader, self._wire), name=f"{self._device} proxy")

    async def close(self) -> None:
        """Close the connection; requests in progress end with DeviceLost."""
        self._fail("the connection was closed")
        if self._reading:
            self._reading.cancel()
            await asyncio.gather(self._reading, return_exceptions=True)
        if self._writer:
            await hang_up(self._writer, self._clock)
            self._writer = None

    async def ask(self, kind: Kind, payload: bytes) -> Answer:
        """Send a request and wait for its answer. Raises DeviceLost, ValueError (too long)."""
        if self._lost or self._writer is None or self._wire is None:
            raise self._lost or DeviceLost(self._device, "not connected")
        self._number = self._number % _LAST_NUMBER + 1
        number, asked_ns = self._number, self._clock.now_ns()
        data = request(number, kind, payload)
        future: asyncio.Future[Answer] = asyncio.get_running_loop().create_future()
        self._pending[number] = kind, future
        self._writer.write(data)
        self._wire.wrote(len(data))
        try:
            async with self._clock.timeout(ANSWER_S):
                answer = await future
        except TimeoutError:
            self._fail(f"the proxy did not answer within {ANSWER_S:g} s")
            assert self._lost
            raise self._lost from None
        self.latency_s = (self._clock.now_ns() - asked_ns) * 1e-9
        return answer

    async def _read(self, reader: asyncio.StreamReader, wire: Wire) -> None:
        stream = AnswerStream()
        try:
            while data := await reader.read(_CHUNK):
                for answer in stream.feed(data):
                    self._take(answer)
                wire.read(len(data))
            self._fail("the proxy closed the connection")
        except (OSError, ValueError) as error:
            self._fail(f"the connection to the proxy broke: {error}")

    def _take(self, answer: Answer) -> None:
        """Give the answer to its request. Raises ValueError if there is no such request: the line is out of step."""
        kind, future = self._pending.get(answer.id, (None, None))
        files_unknown = answer.kind == UNKNOWN and kind in (Kind.FILE_WRITE, Kind.FILE_READ)
        if future is None or (answer.kind != kind and not files_unknown):
            raise ValueError(f"an answer came to message {answer.id} of type {answer.kind}, which was not asked")
        del self._pending[answer.id]
        if not future.done():
            future.set_result(answer)

    def _fail(self, what: str) -> None:
        self._lost = self._lost or DeviceLost(self._device, what, _CURE)
        if self._wire:
            self._wire.close()
        for _, future in self._pending.values():
            if not future.done():
                future.set_exception(self._lost)
        self._pending.clear()
