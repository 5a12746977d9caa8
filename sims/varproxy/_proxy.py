"""The proxy: its messages, bytes in and out, the C3 Bridge's messages about files, and its TCP end."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import final

from sims.faults import Faults
from sims.simulator import Setup
from sims.wires import Client, TcpServer

JOB = "varproxy.job"
ROW = "varproxy.row"
C3, KUKAVARPROXY = "c3_bridge", "kukavarproxy"


GENERAL, SUCCESS, ACCESS, MEMORY, NOT_IMPLEMENTED, PROTOCOL = 0, 1, 2, 4, 7, 9
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


def answer(number: int, kind: int, body: bytes, code: int = SUCCESS, *, ok: bool | None = None) -> bytes:
    """A whole answer; TRUE at its end where it succeeded. `ok`: where that is not what the code says."""
    message = bytes([kind]) + body + code.to_bytes(2, "big") + bytes([code == SUCCESS if ok is None else ok])
    return number.to_bytes(2, "big") + len(message).to_bytes(2, "big") + message


def no_message(number: int) -> bytes:
    """KUKAVARPROXY's answer to a type that it does not know: a length of 0."""
    return number.to_bytes(2, "big") + bytes(2)


WRITE, READ = 29, 30
LARGEST_CHUNK = 64_512
LARGEST_FILE = 1 << 24

_BEGIN, _DATA, _SIZE, _END = 1, 2, 3, 4
_OVERWRITE = 64


@final
class FileDesk:
    """`files`: path → content, of the whole controller. Each request gives code and payload. Raises BadRequest."""

    def __init__(self, files: dict[str, bytes]) -> None:
        self._files = files
        self._out = bytearray()
        self._in = b""

    def write(self, fields: Fields) -> tuple[int, bytes]:
        """Message 29."""
        operation = fields.number(1)
        if operation == _BEGIN:
            size = fields.number(4)
            if size > LARGEST_FILE:
                return MEMORY, bytes([operation]) + _four(0)
            self._out = bytearray(size)
            return SUCCESS, bytes([operation]) + _four(size)
        if operation == _SIZE:
            return SUCCESS, bytes([operation]) + _four(len(self._out))
        if operation == _DATA:
            at, size = fields.number(4), fields.number(4)
            size = max(0, min(size, len(self._out) - at))
            done = bytes([operation]) + _four(at) + _four(size)
            try:
                self._out[at : at + size] = fields.take(size)
            except BadRequest:
                return ACCESS, done
            return SUCCESS, done
        if operation == _END:
            flags, path = fields.number(4), fields.wide_text().upper()
            if path in self._files and not flags & _OVERWRITE:
                return ACCESS, bytes([operation])
            self._files[path] = bytes(self._out)
            self._out = bytearray()
            return SUCCESS, bytes([operation])
        return NOT_IMPLEMENTED, bytes([operation])

    def read(self, fields: Fields) -> tuple[int, bytes]:
        """Message 30."""
        operation = fields.number(1)
        if operation == _BEGIN:
            fields.number(4)
            content = self._files.get(fields.wide_text().upper())
            self._in = content or b""
            return GENERAL if content is None else SUCCESS, bytes([operation]) + _four(len(self._in))
        if operation == _SIZE:
            return SUCCESS, bytes([operation]) + _four(len(self._in))
        if operation == _DATA:
            at, size = fields.number(4), min(fields.number(4), LARGEST_CHUNK)
            part = self._in[at : at + size]
            return SUCCESS, bytes([operation]) + _four(at) + _four(len(part)) + part
        if operation == _END:
            self._in = b""
            return SUCCESS, bytes([operation])
        return NOT_IMPLEMENTED, bytes([operation])


def _four(value: int) -> bytes:
    return value.to_bytes(4, "big")


Answering = Callable[[Request, FileDesk], bytes]
"""The answer to a request; empty: the server hangs up."""


@final
class Talk:
    """What one client asks. `files`: those that it has open."""

    def __init__(self, client: Client, server: ProxyServer, files: FileDesk) -> None:
        self.client, self.files = client, files
        self._server, self._stream = server, RequestStream()

    def feed(self, data: bytes) -> bool:
        """Take the requests in `data`; False where they are none."""
        for request in self._stream.feed(data):
            self._server.take(request, self)
        return not self._stream.broken


@final
class ProxyServer:
    """Answers requests of all clients, on `port` of 127.0.0.1."""

    def __init__(self, setup: Setup, answering: Answering, files: dict[str, bytes]) -> None:
        settings = setup.settings
        self._kernel, self._faults = setup.kernel, setup.faults
        self._answering, self._files = answering, files
        self._least_ns = round(settings["delay_least_ms"] * 1e6)
        self._most_ns = max(self._least_ns, round(settings["delay_most_ms"] * 1e6))
        self._draw = random.Random(f"{setup.cell.simulate.seed} varproxy delays")
        self._free_ns = 0
        self._cut = False
        self._end = TcpServer(setup.kernel, setup.wire, lambda client: Talk(client, self, FileDesk(self._files)))
        self.port = self._end.port
        self._subscribe(setup.faults)

    def take(self, request: Request, talk: Talk) -> None:
        """CrossComm does one request after the other, whoever asks."""
        delay = self._draw.randint(self._least_ns, self._most_ns)
        if slow := self._faults.active("varproxy.slow"):
            delay += round(slow.settings["delay_ms"] * 1e6)
        self._free_ns = max(self._free_ns, self._kernel.now) + delay
        self._kernel.at(self._free_ns, partial(self._do, request, talk))

    def close(self) -> None:
        """Hang up on every client, and stop listening."""
        self._end.close()

    def _subscribe(self, faults: Faults) -> None:
        faults.on_start("varproxy.gone", self._end.hang_up)
        faults.on_end("varproxy.gone", self._end.listen)
        faults.on_start("varproxy.cut", self._cut_next)

    def _do(self, request: Request, talk: Talk) -> None:
        if not talk.client.open:
            return
        data = self._answering(request, talk.files)
        if not data:
            talk.client.close()
            return
        if self._faults.active("varproxy.wrong_id"):
            data = ((request.number + 1) % 65536).to_bytes(2, "big") + data[2:]
        if self._faults.active("varproxy.garbage"):
            data = b"\x00\x01\x00\x03 no message"
        if self._cut:
            self._cut = False
            talk.client.send(data[: len(data) // 2])
            talk.client.close()
            return
        talk.client.send(data)

    def _cut_next(self) -> None:
        self._cut = True
