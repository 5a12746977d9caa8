"""geocompy in a thread: it makes requests and reads answers; the engine's loop carries them (decision 30)."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Final, TypeVar, final

from geocompy.communication import DUMMYLOGGER, Connection
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
from drivers.geocom_tracker.line import Line

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
