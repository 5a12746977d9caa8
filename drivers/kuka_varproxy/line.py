"""The connection to the proxy: one request after the other, each answer matched by its number."""

from __future__ import annotations

import asyncio
from typing import final

from cellctl.clock import Clock, Wire
from cellctl.devices import DeviceLost
from drivers.kuka_varproxy.messages import Answer, AnswerStream, Kind, request
from drivers.tcp_connection import connected, hang_up

ANSWER_S = 5.0
"""Longest wait for an answer, in the cell's time. A variable takes several ms."""

_CHUNK = 65536
_LAST_NUMBER = 0xFFFF
_CURE = (
    "Make sure that the robot stands. Then look at the network, at the proxy's window on the controller, and at what "
    "else talks to it."
)


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
        if future is None or answer.kind != kind:
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
