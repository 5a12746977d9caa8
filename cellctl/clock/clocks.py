"""Clocks of the engine's loop: `now`, `sleep`, `timeout`, the same on a real cell and on a simulated one."""

from __future__ import annotations

import asyncio
import heapq
import itertools
import json
import time
from abc import ABC, abstractmethod
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from typing import ParamSpec, Protocol, Self, TypeVar, final

from cellctl.clock.reading import reader_of

Given = ParamSpec("Given")
Result = TypeVar("Result")


class Timer(Protocol):
    """A callback to come; `cancel` takes it back."""

    def cancel(self) -> None:
        """Take the callback back; nothing happens where it has run."""


class Clock(ABC):
    """The cell's time, in nanoseconds from an arbitrary start, and waiting in it, on one asyncio loop."""

    source: str
    """What `reader_of` makes a reader of in another process."""

    @abstractmethod
    def now_ns(self) -> int:
        """The cell's time in nanoseconds. Safe to call from any thread."""

    @abstractmethod
    def call_later(self, seconds: float, callback: Callable[[], object]) -> Timer:
        """Call `callback` on the loop once `seconds` have passed."""

    async def aclose(self) -> None:  # noqa: B027 - most clocks hold nothing
        """Let go of what the clock holds open."""

    async def compute(self, work: Callable[Given, Result], *given: Given.args, **named: Given.kwargs) -> Result:
        """Do long `work` in a thread, while the loop goes on; the cell's time passes no faster than the wall's."""
        return await asyncio.to_thread(work, *given, **named)

    def now(self) -> float:
        """The cell's time in seconds."""
        return self.now_ns() * 1e-9

    async def sleep(self, seconds: float) -> None:
        """Wait until `seconds` of the cell's time have passed."""
        woken = asyncio.Event()
        timer = self.call_later(seconds, woken.set)
        try:
            await woken.wait()
        finally:
            timer.cancel()

    @asynccontextmanager
    async def timeout(self, seconds: float | None) -> AsyncIterator[None]:
        """Cancel the body after `seconds` of the cell's time and raise TimeoutError; None waits for ever."""
        async with asyncio.timeout(None) as scope:
            loop = asyncio.get_running_loop()
            timer = None if seconds is None else self.call_later(seconds, lambda: scope.reschedule(loop.time()))
            try:
                yield
            finally:
                if timer:
                    timer.cancel()


@final
class WallClock(Clock):
    """CLOCK_MONOTONIC, counted from `epoch_ns`."""

    def __init__(self, epoch_ns: int = 0) -> None:
        self.source = f"wall:{epoch_ns}"
        self._epoch_ns = epoch_ns

    def now_ns(self) -> int:
        """CLOCK_MONOTONIC minus the epoch."""
        return time.monotonic_ns() - self._epoch_ns

    def call_later(self, seconds: float, callback: Callable[[], object]) -> Timer:
        """The loop's own timer."""
        return asyncio.get_running_loop().call_later(seconds, callback)


@final
class LockstepClock(Clock):
    """Time of a simulated cell in lockstep: read from its time file, driven by the ticks on its control port.

    The simulator stands still until each tick is answered, so no timer of the engine is ever more than one tick late,
    however slow the machine. Where the simulator dies, time runs on with the wall, so that time-outs still end.

    A simulated cell with nothing to do runs many times faster than the wall. While the engine computes, it is held to
    the wall's pace: how long a fit may take does not depend on how quickly the simulator gets its processor.
    """

    def __init__(self, time_file: str) -> None:
        self.source = f"file:{time_file}"
        self._read = reader_of(self.source)
        self._timers: list[tuple[int, int, _HeapTimer]] = []
        self._order = itertools.count()
        self._answering: asyncio.Task[None] | None = None
        self._writer: asyncio.StreamWriter | None = None
        self._lost_at: tuple[int, int] | None = None
        self._computing: set[_Computation] = set()

    @classmethod
    async def attach(cls, time_file: str, host: str, port: int) -> Self:
        """Attach to a simulated cell's control port; from here on the cell's time waits for this loop."""
        clock = cls(time_file)
        reader, clock._writer = await asyncio.open_connection(host, port)
        clock._send({"op": "attach", "name": "engine"})
        clock._answering = asyncio.create_task(clock._answer_ticks(reader), name="lockstep ticks")
        return clock

    def now_ns(self) -> int:
        """The simulated cell's time."""
        if self._lost_at is not None:
            cell_ns, wall_ns = self._lost_at
            return cell_ns + time.monotonic_ns() - wall_ns
        return self._read()

    def call_later(self, seconds: float, callback: Callable[[], object]) -> Timer:
        """Call back at the first tick at or after the deadline."""
        timer = _HeapTimer(callback)
        heapq.heappush(self._timers, (self.now_ns() + round(seconds * 1e9), next(self._order), timer))
        return timer

    async def compute(self, work: Callable[Given, Result], *given: Given.args, **named: Given.kwargs) -> Result:
        """As every clock's; ticks are answered at the wall's pace meanwhile."""
        computation = _Computation(self.now_ns(), time.monotonic_ns())
        self._computing.add(computation)
        try:
            return await super().compute(work, *given, **named)
        finally:
            self._computing.discard(computation)
            computation.done.set()

    async def aclose(self) -> None:
        """Detach: the cell's time no longer waits for this loop."""
        if self._answering:
            self._answering.cancel()
            with suppress(asyncio.CancelledError):
                await self._answering
        if self._writer:
            self._writer.close()

    async def _answer_ticks(self, reader: asyncio.StreamReader) -> None:
        with suppress(OSError, ValueError):  # a line that is no JSON, or has no end, is a simulator gone wrong
            while line := await reader.readline():
                await self._answer(json.loads(line))
        self._lost_at = (self._read(), time.monotonic_ns())
        while True:
            self._fire(self.now_ns())
            await asyncio.sleep(0.02)

    async def _answer(self, message: object) -> None:
        tick = message.get("tick") if isinstance(message, dict) else None
        if isinstance(tick, int):
            self._fire(tick)
            for _ in range(4):  # what the timers woke gets its turn before time goes on
                await asyncio.sleep(0)
            for computation in tuple(self._computing):
                await computation.keep_pace(tick)
            self._send({"tock": tick})

    def _fire(self, now_ns: int) -> None:
        while self._timers and self._timers[0][0] <= now_ns:
            heapq.heappop(self._timers)[2].run()

    def _send(self, message: dict[str, object]) -> None:
        if self._writer:
            self._writer.write(json.dumps(message).encode() + b"\n")


class _Computation:
    def __init__(self, cell_ns: int, wall_ns: int) -> None:
        self.done = asyncio.Event()
        self._began = cell_ns, wall_ns

    async def keep_pace(self, cell_ns: int) -> None:
        """Wait until as much time has passed on the wall as in the cell, or the computation is done."""
        began_cell, began_wall = self._began
        ahead_ns = (cell_ns - began_cell) - (time.monotonic_ns() - began_wall)
        if ahead_ns > 0:
            with suppress(TimeoutError):
                await asyncio.wait_for(self.done.wait(), ahead_ns * 1e-9)


class _HeapTimer:
    def __init__(self, callback: Callable[[], object]) -> None:
        self._callback: Callable[[], object] | None = callback

    def cancel(self) -> None:
        self._callback = None

    def run(self) -> None:
        callback, self._callback = self._callback, None
        if callback is None:
            return
        try:
            callback()
        except Exception as error:  # as a loop's own timer: told, and time goes on
            context = {"message": f"a timer of the cell's clock failed: {callback!r}", "exception": error}
            asyncio.get_running_loop().call_exception_handler(context)
