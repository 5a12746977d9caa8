"""Clocks of the engine's loop, the same on a real and a simulated cell; their time in any process; the calendar."""

from __future__ import annotations

import asyncio
import datetime
import heapq
import itertools
import json
import math
import mmap
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from typing import ParamSpec, Protocol, Self, TypeVar, final

from cellctl.clock._wires import CountedWire, UncountedWire, Wire


def calendar_time() -> str:
    """The calendar time in UTC, ISO 8601 to the second, as `2026-11-21T19:24:33Z`."""
    now = datetime.datetime.now(datetime.UTC)  # noqa: TID251 - the one place that may
    return now.strftime("%Y-%m-%dT%H:%M:%SZ")


TimeReader = Callable[[], int]
"""Gives the cell's time in nanoseconds; safe to call from any thread."""


def reader_of(source: str) -> TimeReader:
    """A reader for `source`.

    `wall:EPOCH`: CLOCK_MONOTONIC minus EPOCH nanoseconds, the same in every process of a host.
    `file:PATH`: the 8-byte little-endian integer that a simulated cell keeps up to date in a memory-mapped file.

    Raises ValueError for another kind of source, OSError if the file cannot be mapped.
    """
    kind, _, value = source.partition(":")
    if kind == "wall":
        epoch = int(value)
        return lambda: time.monotonic_ns() - epoch
    if kind == "file":
        return _mapped(Path(value))
    raise ValueError(f"no clock source of kind '{kind}' (in '{source}')")


def _mapped(path: Path) -> TimeReader:
    with path.open("rb") as stream:
        try:
            view = memoryview(mmap.mmap(stream.fileno(), 8, access=mmap.ACCESS_READ)).cast("q")
        except ValueError as error:
            raise OSError(f"{path} is no time file: {error}") from error
    return lambda: view[0]


_BUSY_EVERY_S = 1.0
"""Wall time after which an unanswered tick is reported as in progress; the simulator's time limit is 10 s."""

_LOST_AFTER = 5
"""So many times `_BUSY_EVERY_S` without anything read: the cell's bytes that are missing are lost, not late.

A port discards what it holds when it is opened. Without this limit, such a cell would wait for ever.
"""

Given = ParamSpec("Given")
Result = TypeVar("Result")


class Timer(Protocol):
    """A scheduled callback; `cancel` withdraws it."""

    def cancel(self) -> None:
        """Withdraw the callback; no effect if it has run."""


class Clock(ABC):
    """The cell's time, in nanoseconds from an arbitrary start, and waiting in it, on one asyncio loop."""

    source: str
    """The source from which `reader_of` makes a reader in another process."""

    @abstractmethod
    def now_ns(self) -> int:
        """The cell's time in nanoseconds. Safe to call from any thread."""

    @abstractmethod
    def call_later(self, seconds: float, callback: Callable[[], object]) -> Timer:
        """Call `callback` on the loop once `seconds` have passed."""

    async def aclose(self) -> None:  # noqa: B027 - most clocks hold nothing
        """Release the clock's resources."""

    @contextmanager
    def standing(self) -> Iterator[None]:
        """The body waits for this computer (a thread, a process, a connection): a simulated cell's time stops.

        A real cell's time continues.
        """
        yield

    def wire(self, device: str) -> Wire:
        """A counter of the bytes that a driver reads from and writes to `device`'s wire, from now on."""
        return UncountedWire()

    async def compute(self, work: Callable[Given, Result], *given: Given.args, **named: Given.kwargs) -> Result:
        """Do long `work` in a thread while the loop continues; a simulated cell's time stops meanwhile."""
        with self.standing():
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
        """Cancel the body after `seconds` of the cell's time and raise TimeoutError; None: no limit."""
        async with asyncio.timeout(None) as scope:
            timer = None if seconds is None else self._expire_later(scope, seconds)
            try:
                yield
            finally:
                if timer:
                    timer.cancel()

    def _expire_later(self, scope: asyncio.Timeout, seconds: float) -> Timer:
        loop = asyncio.get_running_loop()
        return self.call_later(seconds, lambda: scope.reschedule(loop.time()))


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

    The simulator waits until each tick is answered. A tick is answered when everything that the simulator
    wrote has been read, every due timer has run, no computation runs, and the loop is about to block. So every run does
    the same at the same cell time, on slow machines too. The answer states when the next timer is due; no timer is more
    than 20 ms late. If the simulator ends, time continues with wall time, so that time-outs still end.
    """

    def __init__(self, time_file: str) -> None:
        self.source = f"file:{time_file}"
        self._read = reader_of(self.source)
        self._timers: list[tuple[int, int, _HeapTimer]] = []
        self._order = itertools.count()
        self._answering: asyncio.Task[None] | None = None
        self._reader: asyncio.StreamReader | None = None
        self._writer: asyncio.StreamWriter | None = None
        self._lost_at: tuple[int, int] | None = None
        self._wires: dict[str, CountedWire] = {}
        self._written_by_cell: dict[str, int] = {}
        self._standing = 0
        self._stated_ns: float | None = None
        self._changed = asyncio.Event()

    @classmethod
    async def attach(cls, time_file: str, host: str, port: int) -> Self:
        """Attach to a simulated cell's control port; from now on the cell's time waits for this loop."""
        clock = cls(time_file)
        clock._reader, clock._writer = await asyncio.open_connection(host, port)
        clock._send({"op": "attach", "name": "engine"})
        clock._answering = asyncio.create_task(clock._answer_ticks(clock._reader), name="lockstep ticks")
        return clock

    def now_ns(self) -> int:
        """The simulated cell's time."""
        if self._lost_at is not None:
            cell_ns, wall_ns = self._lost_at
            return cell_ns + time.monotonic_ns() - wall_ns
        return self._read()

    def call_later(self, seconds: float, callback: Callable[[], object]) -> Timer:
        """Call back at the first tick at or after the deadline."""
        timer, due_ns = _HeapTimer(callback), self.now_ns() + round(seconds * 1e9)
        heapq.heappush(self._timers, (due_ns, next(self._order), timer))
        if self._stated_ns is not None and due_ns < self._stated_ns:
            self._stated_ns = due_ns
            self._send({"next": due_ns})
        return timer

    @contextmanager
    def standing(self) -> Iterator[None]:
        """As every clock's: no tick is answered meanwhile, and the time-outs around the body count wall time.

        Other time-outs count the cell's time still: what they wait for is not late because this computer is at work.
        """
        self._standing += 1
        around, body = _AROUND.get(), _Body()
        inside = _BODY.set(body)
        for expiry in around:
            expiry.count_wall_time(self.now_ns())
        try:
            yield
        finally:
            body.ended = True
            _BODY.reset(inside)
            self._standing -= 1
            for expiry in around:
                expiry.count_cell_time()
            self._changed.set()

    def wire(self, device: str) -> Wire:
        """As every clock's: no tick is answered before what the cell wrote to this wire has been read."""
        loop = asyncio.get_running_loop()
        earlier = self._wires.get(device)
        # the tick for what the earlier wire read last may still be on its way
        before = max(self._written_by_cell.get(device, 0), earlier.bytes_read if earlier else 0)
        loops_thread = threading.get_ident()

        def on_change() -> None:
            if threading.get_ident() == loops_thread:
                self._changed.set()
            else:  # wakes the loop by a byte on its own socket pair, which costs a turn of the loop
                loop.call_soon_threadsafe(self._changed.set)

        wire = CountedWire(before, on_change)
        self._wires[device] = wire
        return wire

    async def aclose(self) -> None:
        """Detach: the cell's time no longer waits for this loop."""
        if self._answering:
            self._answering.cancel()
            with suppress(asyncio.CancelledError):
                await self._answering
        if self._writer:
            self._writer.close()

    def _expire_later(self, scope: asyncio.Timeout, seconds: float) -> Timer:
        expiry = _Expiry(scope, self.now_ns() + round(seconds * 1e9), super()._expire_later(scope, seconds))
        token = _AROUND.set((*_AROUND.get(), expiry))
        expiry.when_over = lambda: _AROUND.reset(token)
        if not _BODY.get().ended:
            expiry.count_wall_time(self.now_ns())
        return expiry

    async def _answer_ticks(self, reader: asyncio.StreamReader) -> None:
        with suppress(OSError, ValueError):  # invalid JSON or a line without end: the simulator is faulty
            while line := await reader.readline():
                await self._answer(json.loads(line))
        self._lost_at = (self._read(), time.monotonic_ns())
        while True:
            self._fire(self.now_ns())
            await asyncio.sleep(0.02)

    async def _answer(self, message: object) -> None:
        tick = message.get("tick") if isinstance(message, dict) else None
        if not isinstance(message, dict) or not isinstance(tick, int):
            return
        self._written_by_cell = message.get("wires", {})
        self._stated_ns = None
        await self._nothing_left_to_do(tick)
        while self._timers and self._timers[0][0] <= tick:
            heapq.heappop(self._timers)[2].run()
            await self._nothing_left_to_do(tick)
        written, due_ns = {name: wire.written for name, wire in self._wires.items()}, self._next_due_ns()
        self._stated_ns = math.inf if due_ns is None else due_ns
        self._send({"tock": tick, "wires": written, "next": due_ns})

    def _next_due_ns(self) -> int | None:
        """When the next timer is due; None without timers."""
        while self._timers and self._timers[0][2].cancelled:
            heapq.heappop(self._timers)
        return self._timers[0][0] if self._timers else None

    async def _nothing_left_to_do(self, tick: int) -> None:
        """Wait until the loop is about to block, all the cell's bytes are read or lost, and no work is in progress."""
        silent = 0
        while not (self._reader and self._reader.at_eof()):  # the simulator has ended: continue with wall time
            await _loop_about_to_block()
            self._changed.clear()
            if not self._standing and self._all_read():
                return
            if self._standing:
                self._send({"busy": tick})  # before the work can block this loop
            try:
                async with asyncio.timeout(_BUSY_EVERY_S):  # not wait_for, which may swallow a cancellation (3.11)
                    await self._changed.wait()
                silent = 0
            except TimeoutError:
                self._send({"busy": tick})
                silent += not self._standing
                if silent >= _LOST_AFTER:
                    for name, wire in self._wires.items():
                        wire.catch_up(self._written_by_cell.get(name, 0))

    def _all_read(self) -> bool:
        return all(wire.has_read(self._written_by_cell.get(name, 0)) for name, wire in self._wires.items())

    def _fire(self, now_ns: int) -> None:
        while self._timers and self._timers[0][0] <= now_ns:
            heapq.heappop(self._timers)[2].run()

    def _send(self, message: dict[str, object]) -> None:
        if self._writer:
            self._writer.write(json.dumps(message).encode() + b"\n")


async def _loop_about_to_block() -> None:
    """Wait until nothing but the caller is ready to run: another turn of the loop would wait for files or timers.

    asyncio has no public function for that; every loop of the standard library keeps ready callbacks in `_ready`.
    """
    ready = asyncio.get_running_loop()._ready  # type: ignore[attr-defined]
    await asyncio.sleep(0)
    while ready:
        await asyncio.sleep(0)


class _Expiry:
    """The end of a `timeout`, at `due_ns` of the cell's time; in wall time while a body in it stops the cell's time."""

    def __init__(self, scope: asyncio.Timeout, due_ns: int, timer: Timer) -> None:
        self.when_over: Callable[[], object] = lambda: None
        self._scope, self._due_ns, self._timer = scope, due_ns, timer
        self._bodies = 0
        self._over = False

    def count_wall_time(self, now_ns: int) -> None:
        self._bodies += 1
        if self._bodies == 1 and self._counts:
            self._scope.reschedule(asyncio.get_running_loop().time() + (self._due_ns - now_ns) * 1e-9)

    def count_cell_time(self) -> None:
        self._bodies -= 1
        if not self._bodies and self._counts:
            self._scope.reschedule(None)

    @property
    def _counts(self) -> bool:
        """Whether it can still expire: a task that outlives the time-out has it around itself too."""
        return not self._over and not self._scope.expired()

    def cancel(self) -> None:
        self._over = True
        self._timer.cancel()
        self.when_over()


_AROUND: ContextVar[tuple[_Expiry, ...]] = ContextVar("_AROUND", default=())
"""The time-outs around the code that runs, in it and in the tasks that it started."""


class _Body:
    """A body that stops the cell's time."""

    def __init__(self, *, ended: bool = False) -> None:
        self.ended = ended


_BODY: ContextVar[_Body] = ContextVar("_BODY", default=_Body(ended=True))  # noqa: B039 - never changed
"""The body that runs, or whose task runs."""


class _HeapTimer:
    def __init__(self, callback: Callable[[], object]) -> None:
        self._callback: Callable[[], object] | None = callback

    @property
    def cancelled(self) -> bool:
        return self._callback is None

    def cancel(self) -> None:
        self._callback = None

    def run(self) -> None:
        callback, self._callback = self._callback, None
        if callback is None:
            return
        try:
            callback()
        except Exception as error:  # as a loop's own timer: reported, and time continues
            context = {"message": f"a timer of the cell's clock failed: {callback!r}", "exception": error}
            asyncio.get_running_loop().call_exception_handler(context)
