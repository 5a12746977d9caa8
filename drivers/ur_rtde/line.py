"""The RTDE connection: agreed with the controller, streaming samples on demand, writing registers."""

from __future__ import annotations

import asyncio
import struct
from collections import deque
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from typing import Final, final

from cellctl.clock import Clock, Wire
from cellctl.devices import DeviceError, DeviceLost, DeviceRefused
from drivers.seen_through import see_through
from drivers.tcp_connection import connected, hang_up
from drivers.ur_rtde.codec import (
    PROTOCOL,
    Kind,
    Package,
    PackageStream,
    Recipe,
    Value,
    inputs_request,
    outputs_request,
    packed,
    recipe_of,
    text_of,
)
from drivers.ur_rtde.state import OUTPUTS, Sample

ANSWER_S = 2.0
"""Longest wait for an answer, in the cell's time. The controller answers within some cycles of 2 or 8 ms."""

RECENT_S = 0.5
"""A sample older than this says nothing of now; a stream without one for so long is lost."""

_AHEAD_S = 0.25
"""The controller's clock jumped if it is ahead by more: no sample comes before it was taken. An honest one may be ahead
of the first sample by what that one was late; a computer that is late by more stops the motion anyway."""

_CHUNK = 65536
_OLDEST: Final = {3: (3, 10), 5: (5, 4)}
"""By generation: CB3, e-Series. `safety_status` and the registers from 24 on are there since then."""

_CURE = "Make sure that the robot stands. Then look at the network, at the pendant, and at what else talks to it."


@final
class RtdeLine:
    """One RTDE connection. It is given up at the first package that cannot be one, or is not the next.

    `version`: of the controller's software, as (5, 12, 2, 0). `messages`: the latest texts of the controller.
    `skipped`: samples that the controller left out; `stale`: packages that were not newer than the one before.
    """

    def __init__(self, device: str, place: tuple[str, int], clock: Clock) -> None:
        self.version: tuple[int, ...] = ()
        self.messages: deque[str] = deque(maxlen=20)
        self.skipped = 0
        self.stale = 0
        self._device, self._place, self._clock = device, place, clock
        self._answers: dict[int, asyncio.Future[bytes]] = {}
        self._inputs: dict[str, Recipe] = {}
        self._outputs: Recipe | None = None
        self._period_s = 0.0
        self._latest: Sample | None = None
        self._ahead_ns = 0.0
        self._stream = asyncio.Lock()
        self._took: Callable[[Sample], object] = lambda _: None
        self._news = asyncio.Event()
        self._writer: asyncio.StreamWriter | None = None
        self._wire: Wire | None = None
        self._reading: asyncio.Task[None] | None = None
        self._lost: DeviceLost | None = None

    @property
    def rate_hz(self) -> float:
        """How often the controller computes: 500 Hz of the e-Series, 125 Hz of CB3."""
        return 125.0 if self.version[:1] == (3,) else 500.0

    async def open(self) -> Wire:
        """Connect and agree on protocol and software; returns the wire. Raises DeviceUnreachable, DeviceRefused."""
        cure = "Is the controller on, and are its RTDE service (Settings, Security, Services) and the cable in order?"
        reader, self._writer, self._wire = await connected(
            self._device, self._place, self._clock, peer="RTDE of a Universal Robots controller", cure=cure
        )
        self._reading = asyncio.create_task(self._read(reader, self._wire), name=f"{self._device} RTDE")
        accepted = await self._ask(Kind.REQUEST_PROTOCOL, packed(Kind.REQUEST_PROTOCOL, struct.pack(">H", PROTOCOL)))
        if accepted != b"\x01":
            raise DeviceRefused(self._device, f"the controller does not speak RTDE {PROTOCOL}", "Update its software.")
        answer = await self._ask(Kind.CONTROLLER_VERSION, packed(Kind.CONTROLLER_VERSION))
        if len(answer) < 12:
            raise DeviceRefused(self._device, "the controller states no version of its software")
        self.version = struct.unpack(f">{len(answer) // 4}I", answer[: len(answer) // 4 * 4])
        oldest = _OLDEST.get(self.version[0])
        if oldest and self.version[:2] < oldest:
            stated, needed = ".".join(map(str, self.version[:3])), ".".join(map(str, oldest))
            raise DeviceRefused(self._device, f"its software is {stated}; {needed} is needed", "Update it.")
        return self._wire

    async def close(self) -> None:
        """Close the connection; what waits on it ends with DeviceLost."""
        self._fail("the connection was closed")
        if self._reading:
            self._reading.cancel()
            await asyncio.gather(self._reading, return_exceptions=True)
        if self._writer:
            await hang_up(self._writer, self._clock)
            self._writer = None

    async def reserve(self, name: str, variables: tuple[str, ...]) -> None:
        """An input recipe `name` of these variables, for `write`. Raises DeviceRefused if another program has one."""
        answer = await self._ask(Kind.INPUTS, inputs_request(variables))
        try:
            self._inputs[name] = recipe_of(variables, answer)
        except ValueError as error:
            cure = "End the other program that is connected to RTDE, or a fieldbus that uses these registers."
            raise DeviceRefused(self._device, f"RTDE: {error}", cure) from error

    def write(self, name: str, values: Mapping[str, Value]) -> None:
        """Set the variables of the recipe `name`, all in one cycle of the controller. Raises DeviceLost."""
        self._send(self._inputs[name].pack(values))

    @asynccontextmanager
    async def streaming(self, hz: float, took: Callable[[Sample], object] = lambda _: None) -> AsyncIterator[None]:
        """Samples come in the body, `hz` times a second; `took` has each. Raises DeviceLost, DeviceRefused.

        One stream at a time: another one waits. It begins with a first sample.
        """
        async with self._stream:
            request = outputs_request(OUTPUTS, hz)
            try:
                self._outputs = recipe_of(OUTPUTS, await self._ask(Kind.OUTPUTS, request))
            except ValueError as error:
                raise DeviceRefused(self._device, f"RTDE: {error}", "Update the controller's software.") from error
            self._latest, self._period_s, self._took = None, 1 / hz, took
            self._news.clear()
            try:
                if await self._ask(Kind.START, packed(Kind.START)) != b"\x01":
                    raise DeviceRefused(self._device, "the controller does not start RTDE's data")
                await self.next(ANSWER_S)
                yield
            finally:
                self._took = lambda _: None
                if not self._lost:
                    await self._ask(Kind.PAUSE, packed(Kind.PAUSE))
                self._latest = None

    @property
    def streams(self) -> bool:
        """Whether a stream is open, or about to be."""
        return self._stream.locked()

    def recent(self) -> Sample | None:
        """The last sample of the open stream, if it is one of now."""
        latest = self._latest
        return latest if latest and self._clock.now_ns() - latest.arrival_ns < RECENT_S * 1e9 else None

    async def next(self, limit_s: float) -> Sample:
        """The last sample, once there is one since the last call. Raises DeviceLost if none comes within `limit_s`."""
        try:
            async with self._clock.timeout(limit_s):
                await self._news.wait()
        except TimeoutError:
            self._fail(f"no data came for {limit_s:g} s")
        self._news.clear()
        if self._lost or self._latest is None:
            raise self._lost or DeviceLost(self._device, "no data came")
        return self._latest

    # internal

    async def _ask(self, kind: Kind, request: bytes) -> bytes:
        """The answer; a cancellation waits for it, or it would come later, unasked for. Raises DeviceLost."""
        return await see_through(self._answer(kind, request))

    async def _answer(self, kind: Kind, request: bytes) -> bytes:
        if kind in self._answers:
            raise DeviceRefused(self._device, "another command is under way")
        future: asyncio.Future[bytes] = asyncio.get_running_loop().create_future()
        self._answers[kind] = future
        try:
            self._send(request)
            async with self._clock.timeout(ANSWER_S):
                return await future
        except TimeoutError:
            self._fail(f"the controller did not answer within {ANSWER_S:g} s")
            assert self._lost
            raise self._lost from None
        finally:
            self._answers.pop(kind, None)

    def _send(self, data: bytes) -> None:
        if self._lost or self._writer is None or self._wire is None:
            raise self._lost or DeviceLost(self._device, "not connected")
        self._writer.write(data)
        self._wire.wrote(len(data))

    async def _read(self, reader: asyncio.StreamReader, wire: Wire) -> None:
        stream = PackageStream()
        try:
            while data := await reader.read(_CHUNK):
                for package in stream.feed(data):
                    self._take(package)
                wire.read(len(data))
            self._fail("the controller closed the connection")
        except (OSError, ValueError, struct.error) as error:
            self._fail(f"the RTDE connection broke: {error}")

    def _take(self, package: Package) -> None:
        if package.kind == Kind.DATA:
            if self._outputs:
                self._take_sample(Sample.of(self._outputs.unpack(package.payload), self._clock.now_ns()))
        elif package.kind == Kind.TEXT:
            self.messages.append(text_of(package.payload))
        elif (future := self._answers.get(package.kind)) and not future.done():
            future.set_result(package.payload)
        else:
            raise ValueError(f"a package of type {package.kind} came that was not asked for")

    def _take_sample(self, sample: Sample) -> None:
        """Raises ValueError if the controller's clock jumped: it was started again, or another one answers."""
        ahead_ns = sample.time_s * 1e9 - sample.arrival_ns
        if self._latest:
            step = sample.time_s - self._latest.time_s
            if step < -1.5 * self._period_s:
                raise ValueError(f"the controller's clock went back by {-step:.3f} s: it was started again")
            if step < self._period_s / 2:
                self.stale += 1
                return
            if ahead_ns - self._ahead_ns > _AHEAD_S * 1e9:
                raise ValueError(f"the controller's clock jumped by {(ahead_ns - self._ahead_ns) * 1e-9:.3f} s")
            self.skipped += round(step / self._period_s) - 1
        self._ahead_ns = max(ahead_ns, self._ahead_ns) if self._latest else ahead_ns
        self._latest = sample
        self._took(sample)
        self._news.set()

    def _fail(self, what: str) -> None:
        self._lost = self._lost or DeviceLost(self._device, what, _CURE)
        if self._wire:
            self._wire.close()
        self._news.set()
        for future in self._answers.values():
            if not future.done():
                future.set_exception(self._lost)

    def error(self) -> DeviceError | None:
        """Why the line was given up; None while it is in order."""
        return self._lost
