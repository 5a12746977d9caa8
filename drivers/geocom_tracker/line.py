"""The serial line, one request at a time, on the loop; and geocompy in a thread, whose requests it carries."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final, TypeVar, final

from geocompy.communication import DUMMYLOGGER, Connection, crc16_bytewise
from geocompy.geo import GeoCom
from geocompy.geo.aus import GeoComAUS
from geocompy.geo.aut import GeoComAUT
from geocompy.geo.bap import GeoComBAP
from geocompy.geo.com import GeoComCOM
from geocompy.geo.csv import GeoComCSV
from geocompy.geo.gctypes import GeoComResponse
from geocompy.geo.mot import GeoComMOT
from geocompy.geo.tmc import GeoComTMC

from cellctl.clock import Clock
from cellctl.devices import DeviceLost
from drivers.serial_port import SerialPort

_END: Final = b"\r\n"
_LONGEST: Final = 4096
"""Bytes without an end of line after which they are discarded."""
_DEAD_PEER_S: Final = 120.0
"""Wall time: a simulated cell whose time does not advance must not hold a request for ever."""
_ANSWER: Final = re.compile(rb"%R1P,\d+,(\d+),(\d+):\d+(?:,[ -~]*)?")
_REQUEST: Final = re.compile(r"%R1Q,\d+,(\d+)")
_INTERRUPTED: Final = 8
_UNREADABLE: Final = ""
"""In place of a line without the form of an answer with a check sum: geocompy would take one without."""
_ABORT: Final = b"c"
_ABORTED: Final = b"?"
"""The answer to an abort, and then the only one to the request that it interrupted."""


@final
@dataclass(slots=True)
class Counts:
    """Counts of the line since it was opened. stray: valid answers to no request in flight: late or doubled ones."""

    requests: int = 0
    missing: int = 0
    garbled: int = 0
    stray: int = 0


@final
class Line:
    """The open line. Raises DeviceLost once the port is lost."""

    def __init__(self, device: str, port: SerialPort, clock: Clock) -> None:
        self.counts = Counts()
        self._device, self._port, self._clock = device, port, clock
        self._wire = clock.wire(device)
        self._buffer = b""
        self._awaited: tuple[int, asyncio.Future[str]] | None = None
        self._interrupted: int | None = None
        self._clear_first = True
        self._why_lost = ""
        self._loop = asyncio.get_running_loop()
        self._reading: int | None = port.fileno()
        self._loop.add_reader(self._reading, self._readable)

    @property
    def in_flight(self) -> bool:
        """Whether a request waits for its answer."""
        return self._awaited is not None

    def check(self) -> None:
        """Raises DeviceLost if the port was lost."""
        if self._why_lost:
            raise DeviceLost(self._device, self._why_lost, "check the cable, the adapter and the instrument's supply")

    async def ask(self, request: str, within_s: float) -> str:
        """Send a request without its end, and return the answer without its end, whether its check sum is right or not.

        within_s: of the cell's time. Raises TimeoutError without an answer, DeviceLost.
        """
        answer: asyncio.Future[str] = self._loop.create_future()
        self._awaited = _transaction(request), answer
        self.counts.requests += 1
        try:
            self._send(request)
            async with asyncio.timeout(_DEAD_PEER_S), self._clock.timeout(within_s):
                return await answer
        except TimeoutError:
            self.counts.missing += 1
            self._clear_first = True
            raise
        finally:
            self._awaited = None

    def abort(self) -> None:
        """Interrupt the motion in progress: its request then ends with return code 8."""
        self._interrupted = self._awaited[0] if self._awaited else None
        if not self._why_lost:
            self._write(_ABORT + _END)

    def close(self) -> None:
        """Close the port."""
        self._release()
        self._port.close()

    def _send(self, request: str) -> None:
        """A line feed first empties the instrument's receive buffer, after anything went wrong."""
        self.check()
        clear, self._clear_first = b"\n" if self._clear_first else b"", False
        self._write(clear + request.encode("ascii") + _END)
        self.check()

    def _write(self, data: bytes) -> None:
        try:
            self._port.write(data)
            self._wire.wrote(len(data))
        except OSError as error:
            self._lose(f"the port takes nothing more ({error})")

    def _readable(self) -> None:
        try:
            data = self._port.read()
        except (OSError, TypeError) as error:
            self._lose(f"the port was lost ({error})")
            return
        *lines, rest = (self._buffer + data).split(b"\n")
        self._buffer = rest[-_LONGEST:]
        for line in lines:
            self._take(line.strip(b"\r"))
        self._wire.read(len(data))

    def _take(self, line: bytes) -> None:
        if line == _ABORTED:
            self._answer_aborted()
        if line in (b"", _ABORTED):
            return
        transaction = _valid_transaction(line)
        if transaction is None:
            self.counts.garbled += 1
            self._clear_first = True
        if self._awaited and transaction in (None, self._awaited[0]) and not self._awaited[1].done():
            self._awaited[1].set_result(line.decode("ascii") if _ANSWER.fullmatch(line) else _UNREADABLE)
        elif transaction is not None:
            self.counts.stray += 1

    def _answer_aborted(self) -> None:
        """In place of the answer that an interrupted request does not get: return code 8, with its check sum."""
        if self._awaited and self._awaited[0] == self._interrupted and not self._awaited[1].done():
            head, tail = f"%R1P,0,{self._awaited[0]}", f":{_INTERRUPTED}"
            self._awaited[1].set_result(f"{head},{crc16_bytewise(head + tail)}{tail}")

    def _lose(self, why: str) -> None:
        self._why_lost = self._why_lost or why
        self._release()
        if self._awaited and not self._awaited[1].done():
            self._awaited[1].set_exception(DeviceLost(self._device, why, "check the cable and the adapter"))

    def _release(self) -> None:
        if self._reading is not None:
            self._loop.remove_reader(self._reading)
            self._wire.close()
        self._reading = None


def _transaction(request: str) -> int:
    match = _REQUEST.match(request)
    return int(match[1]) if match else -1


def _valid_transaction(line: bytes) -> int | None:
    """The transaction number of an answer whose check sum is right; None for every other line."""
    match = _ANSWER.fullmatch(line)
    if match is None:
        return None
    start, end = match.span(2)
    body = line[: start - 1] + line[end:]
    return int(match[1]) if crc16_bytewise(body) == int(match[2]) else None


_GUARD_S: Final = 600.0
"""Wall time after which the thread gives up on a loop that has ended."""
_TRANSACTIONS: Final = 2**15
_DIGITS: Final = 15

Params = TypeVar("Params")
_Request = tuple[str, "Future[str]"]


@final
class Geocom(GeoCom):
    """geocompy's GeoCom without the start of its constructor, which sleeps 1 s and refuses an instrument that sleeps.

    first: number of the first transaction, so that a late answer to an earlier session has another number.
    """

    def __init__(self, connection: Connection, first: int) -> None:
        self._conn, self._logger, self._checksum = connection, DUMMYLOGGER, True
        self.transaction_counter = first % _TRANSACTIONS
        self.precision = _DIGITS
        self.aus, self.aut, self.bap = GeoComAUS(self), GeoComAUT(self), GeoComBAP(self)
        self.com, self.csv = GeoComCOM(self), GeoComCSV(self)
        self.mot, self.tmc = GeoComMOT(self), GeoComTMC(self)


@final
class Library:
    """Calls of geocompy, one at a time, over `line`. The cell's time stops while geocompy computes."""

    def __init__(self, device: str, line: Line, clock: Clock) -> None:
        self._line, self._clock = line, clock
        self._handover = _Handover()
        self._geocom = Geocom(self._handover, clock.now_ns() // 1_000_000)
        self._thread = ThreadPoolExecutor(1, thread_name_prefix=f"{device} library")
        self._one = asyncio.Lock()

    async def call(self, work: Callable[[GeoCom], GeoComResponse[Params]], within_s: float) -> GeoComResponse[Params]:
        """The response to one request. within_s: of the cell's time, for its answer. Raises DeviceLost."""
        async with self._one:
            loop, requests = asyncio.get_running_loop(), asyncio.Queue[_Request | None]()
            self._handover.requests = _Requests(loop, requests)
            ended = loop.run_in_executor(self._thread, work, self._geocom)
            ended.add_done_callback(lambda _: requests.put_nowait(None))
            try:
                while request := await self._next(requests):
                    await self._deliver(request, within_s)
            finally:
                self._handover.requests.close()
            self._line.check()
            return ended.result()

    def close(self) -> None:
        """End the thread."""
        self._handover.close()
        self._thread.shutdown(wait=False, cancel_futures=True)

    async def _next(self, requests: asyncio.Queue[_Request | None]) -> _Request | None:
        with self._clock.standing():
            return await requests.get()

    async def _deliver(self, request: _Request, within_s: float) -> None:
        text, answer = request
        try:
            answer.set_result(await self._line.ask(text, within_s))
        except (TimeoutError, DeviceLost) as error:
            answer.set_exception(error)
        except BaseException:  # cancelled: the thread must not wait for ever
            answer.set_exception(ConnectionError("the request was given up"))
            raise


class _Requests:
    """Requests from the thread to the loop, until closed."""

    def __init__(self, loop: asyncio.AbstractEventLoop, queue: asyncio.Queue[_Request | None]) -> None:
        self._loop, self._queue, self._open = loop, queue, True

    def put(self, text: str) -> Future[str]:
        """Hand a request over. In the thread."""
        answer: Future[str] = Future()
        self._loop.call_soon_threadsafe(self._take, (text, answer))
        return answer

    def close(self) -> None:
        """Refuse all requests that were not taken. On the loop."""
        self._open = False
        while not self._queue.empty():
            if request := self._queue.get_nowait():
                _refuse(request)

    def _take(self, request: _Request) -> None:
        if self._open:
            self._queue.put_nowait(request)
        else:
            _refuse(request)


def _refuse(request: _Request) -> None:
    request[1].set_exception(ConnectionError("the request was given up"))


@final
class _Handover(Connection):
    """geocompy's connection: each exchange waits in geocompy's thread until the loop has the answer."""

    def __init__(self) -> None:
        self.requests: _Requests | None = None

    def exchange(self, cmd: str) -> str:
        """The answer to a request. Raises TimeoutError, ConnectionError."""
        if self.requests is None:
            raise ConnectionError("the line is closed")
        try:
            return self.requests.put(cmd).result(_GUARD_S)
        except DeviceLost as loss:
            raise ConnectionError(str(loss)) from loss

    def is_open(self) -> bool:
        """Whether requests are taken."""
        return self.requests is not None

    def close(self) -> None:
        """Take no more requests."""
        self.requests = None

    def reset(self) -> None:
        """Nothing: the line finds answers by their number."""

    def send(self, message: str) -> None:
        """Not used: GeoCOM answers every request."""
        raise NotImplementedError

    def receive(self) -> str:
        """Not used: GeoCOM sends nothing unasked."""
        raise NotImplementedError

    def send_binary(self, data: bytes) -> None:
        """Not used."""
        raise NotImplementedError

    def receive_binary(self) -> bytes:
        """Not used."""
        raise NotImplementedError

    def exchange_binary(self, data: bytes) -> bytes:
        """Not used."""
        raise NotImplementedError
