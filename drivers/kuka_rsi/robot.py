"""The robot as campaigns know it: moves by the controller, searches by RSI, always held."""

from __future__ import annotations

import asyncio
import itertools
import math
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from typing import final

from cellctl.clock import Clock
from cellctl.devices import (
    DeviceError,
    DeviceFault,
    DeviceLost,
    DeviceRefused,
    Guard,
    Health,
    Identity,
    JointReadings,
    LimitExceeded,
    SearchResult,
)
from drivers.kuka_rsi.eki_channel import EkiChannel
from drivers.kuka_rsi.eki_documents import Reply, point_to_point
from drivers.kuka_rsi.ethernet_config import read_ethernet_config
from drivers.kuka_rsi.limits import AXES, SearchLimits
from drivers.kuka_rsi.process import CyclicProcess
from drivers.kuka_rsi.refusals import cure_of, refusal
from drivers.kuka_rsi.search_cycle import SearchOrder
from drivers.kuka_rsi.searching import Search
from drivers.kuka_rsi.seen_through import see_through
from drivers.kuka_rsi.settings import RsiSettings
from drivers.kuka_rsi.shared_block import GUARDS, SharedBlock, Slot
from drivers.kuka_rsi.telegram import ReplyFormat

_ENGINE = "engine"
_BEAT_S = 0.05
_OLDEST_BEAT_S = 0.25

_SLOW_AXIS_DEG_S = 30.0
"""No axis is slower at 100 %; from it a move's time-out is computed."""

_MOVE_BESIDES_S = 15.0
_HALT_S = 10.0


@final
class KukaRobot:
    """A KUKA robot: RSI in a process of its own, EthernetKRL for the rest. Implements SearchingRobot and Listener."""

    def __init__(self, name: str, settings: RsiSettings, clock: Clock, limits: SearchLimits) -> None:
        self.name = name
        self._settings = settings
        self._clock = clock
        self._limits = limits
        self._eki: EkiChannel | None = None
        self._process: CyclicProcess | None = None
        self._identity: Identity | None = None
        self._beating: asyncio.Task[None] | None = None
        self._searches = itertools.count(1)
        self._search = 0
        self._busy = False
        self._guards: dict[str, int] = {_ENGINE: 0}

    @property
    def axes(self) -> int:
        """Six: what a telegram carries."""
        return AXES

    # the line

    async def connect(self) -> Identity:
        """Start the RSI process, open the EthernetKRL channel and ask who is there.

        Raises DeviceRefused (mistakes in the Ethernet configuration), DeviceUnreachable (port taken, no controller),
        DeviceFault (a message stands at the controller). No telegram is needed for it, and nothing moves.
        """
        if self._identity:
            return self._identity
        try:
            self._process = await self._start_process()
            self._eki = EkiChannel(self.name, self._settings.eki, self._clock)
            await self._eki.open()
            self._beating = asyncio.create_task(self._beat(), name=f"{self.name} heartbeat")
            self._identity = await self._ask_identity(self._eki)
        except BaseException:
            await see_through(self._let_go())
            raise
        return self._identity

    async def close(self) -> None:
        """Stop the robot, end the process, let go of the line."""
        await self.stop()
        await see_through(self._let_go())

    def listening(self) -> tuple[str, int]:
        """Host and port bound for the controller's telegrams. Raises DeviceLost before `connect`."""
        return self._connected_process().listening

    async def health(self) -> Health:
        """State of controller and cyclic process; counts since `connect`. Raises DeviceLost."""
        process, stat = self._connected_process(), self._connected_eki().stat
        if not process.alive():
            raise DeviceLost(self.name, f"the RSI process ended: {process.last_words()}")
        words = process.block.words
        counted = (Slot.TELEGRAMS, Slot.LATE, Slot.LATE_REPORTED, Slot.LOST, Slot.SKIPPED, Slot.MALFORMED)
        figures = {slot.name.lower(): float(words[slot]) for slot in counted}
        figures |= {"cycle_ms": words[Slot.CYCLE] * 1e-6, "real_time": float(process.real_time)}
        figures["unreadable"] = float(self._connected_eki().unreadable)
        text = f"{stat.mode}, {stat.program}" + (f": {stat.message}" if stat.message else "")
        text += "" if process.real_time else "; no real-time priority for RSI (grant CAP_SYS_NICE or an rtprio limit)"
        return Health(stat.program != "ERROR" and stat.mode == "EXT", text, figures)

    async def reset(self) -> None:
        """Acknowledge messages and select the program again. Raises DeviceRefused, DeviceFault, DeviceLost."""
        reply = await self._connected_eki().ask("RESET")
        if reply.code:
            raise refusal(self.name, reply, "reset")

    # motion

    async def joints(self) -> JointReadings:
        """Actual joints now, degrees. Raises DeviceLost."""
        reply = await self._connected_eki().ask("HELLO")
        return reply.joints or self._connected_eki().latest_joints

    async def move(self, target: JointReadings, speed_percent: float) -> JointReadings:
        """Point to point, planned by the controller; returns the actual joints on arrival, degrees."""
        self._check_joints(target)
        if not 0 < speed_percent <= 100:
            raise LimitExceeded(self.name, f"move: speed {speed_percent:g} % is not within 0 … 100 %")
        async with self._held_in_trouble():
            eki = self._connected_eki()
            farthest = max(abs(a - b) for a, b in zip(target, eki.latest_joints, strict=True))
            limit_s = 2 * farthest / (_SLOW_AXIS_DEG_S * speed_percent / 100) + _MOVE_BESIDES_S
            pending = await eki.send("PTP", point_to_point(target, speed_percent))
            try:
                reply = await pending.reply(limit_s)
            except TimeoutError:
                raise DeviceLost(self.name, f"the move of {farthest:.1f} deg did not end in {limit_s:.0f} s") from None
            return self._arrived(reply)

    async def search(
        self, end: JointReadings, speed_deg_s: float, guards: dict[str, float] | None = None
    ) -> SearchResult:
        """Go along the joint-space line to `end` until `stop_now`, the end, or trouble; see SearchingRobot."""
        self._check_joints(end)
        async with self._held_in_trouble():
            process, eki = self._connected_process(), self._connected_eki()
            start = eki.latest_joints
            correction = tuple(b - a for a, b in zip(start, end, strict=True))
            if passed := self._limits.passed_by(correction, speed_deg_s):
                raise LimitExceeded(self.name, f"search: {', '.join(passed)}")
            if not speed_deg_s > 0:
                raise LimitExceeded(self.name, f"search: speed {speed_deg_s:g} deg/s is not positive")
            oldest = self._oldest_beats(guards or {})
            self._search = next(self._searches)
            order = SearchOrder(self._search, start, correction, speed_deg_s, oldest)
            names, file = tuple(self._guards), str(self._settings.ethernet)
            return await Search(self.name, self._clock, eki, process, order, names, file).run()

    def stop_now(self) -> None:
        """Stop the running search; safe from any thread, never blocks."""
        if process := self._process:
            process.block.words[Slot.STOP] = self._search

    async def stop(self) -> None:
        """Hold the robot whatever it does."""
        self.stop_now()
        if self._moving():
            await see_through(self._halt())

    def guard(self, name: str) -> Guard:
        """The slot in which `name`'s proof of life is left. Raises ValueError where all are taken."""
        slot = self._guards.setdefault(name, len(self._guards))
        if slot >= GUARDS:
            del self._guards[name]
            raise ValueError(f"{self.name}: no more than {GUARDS - 1} guards")
        return _SlotGuard(lambda: self._process and self._process.block, slot)

    # inner works

    async def _start_process(self) -> CyclicProcess:
        config = read_ethernet_config(self._settings)
        if config.mistakes:
            cure = "Correct the file, and load the same one on the controller."
            raise DeviceRefused(self.name, "; ".join(config.mistakes), cure)
        reply = ReplyFormat.of(config.sentype, config.receive, self._settings.correction, self._settings.stop)
        return await CyclicProcess.start(
            self.name, self._settings.bind, self._clock.source, reply.template, self._limits, self._settings.mode
        )

    async def _ask_identity(self, eki: EkiChannel) -> Identity:
        reply = await eki.ask("HELLO")
        if reply.code:
            raise refusal(self.name, reply, "HELLO")
        stat = await eki.first_stat()
        if stat.program == "ERROR":
            raise DeviceFault(self.name, f"a message stands at the controller: {stat.message}", cure_of(stat.message))
        serial = reply.ident.get("Serial", "")
        model, kss = reply.ident.get("Model", ""), reply.ident.get("KSS", "")
        return Identity(self.name, serial, model, f"KSS {kss}", serial.startswith("SIM-"))

    async def _let_go(self) -> None:
        if self._beating:
            self._beating.cancel()
            await asyncio.gather(self._beating, return_exceptions=True)
        eki, process = self._eki, self._process
        self._identity = self._beating = self._eki = self._process = None
        if eki:
            await eki.close()
        if process:
            await process.end()

    async def _beat(self) -> None:
        """The engine's own proof of life: where its loop hangs, these stop and the cyclic process holds the robot."""
        guard = self.guard(_ENGINE)
        while True:
            guard.beat(self._clock.now_ns())
            await self._clock.sleep(_BEAT_S)

    @asynccontextmanager
    async def _held_in_trouble(self) -> AsyncIterator[None]:
        """One command at a time; where it ends otherwise than by the controller's own word, the robot is halted."""
        if self._busy:
            raise DeviceRefused(self.name, "another command is under way")
        self._busy = True
        try:
            yield
        except (DeviceRefused, DeviceFault, LimitExceeded):
            raise
        except BaseException:
            self.stop_now()
            await see_through(self._halt())
            raise
        finally:
            self._busy = False

    async def _halt(self) -> None:
        """Ask for standstill and wait for it; without a connection the controller holds the robot by itself.

        The search is released only once RSI is known to be off: zero would send the robot back to the search's start.
        """
        with suppress(DeviceError):
            if self._eki and self._process:
                await self._eki.ask("HALT", _HALT_S)
                self._process.block.release()

    def _moving(self) -> bool:
        with suppress(DeviceLost):
            return self._busy or self._connected_eki().stat.program in ("MOVING", "RSI")
        return False

    def _arrived(self, reply: Reply) -> JointReadings:
        if reply.code:
            raise refusal(self.name, reply, "move")
        return reply.joints or self._connected_eki().latest_joints

    def _oldest_beats(self, guards: dict[str, float]) -> tuple[int, ...]:
        oldest = [0] * GUARDS
        for name, seconds in {_ENGINE: _OLDEST_BEAT_S, **guards}.items():
            self.guard(name)
            oldest[self._guards[name]] = round(seconds * 1e9)
        return tuple(oldest)

    def _check_joints(self, joints: JointReadings) -> None:
        if len(joints) != AXES or not all(map(math.isfinite, joints)):
            raise LimitExceeded(self.name, f"{joints} are not {AXES} joint readings")

    def _connected_process(self) -> CyclicProcess:
        if self._process is None:
            raise DeviceLost(self.name, "not connected")
        return self._process

    def _connected_eki(self) -> EkiChannel:
        if self._eki is None:
            raise DeviceLost(self.name, "not connected")
        return self._eki


@final
class _SlotGuard:
    """Leaves beats in a slot of the shared block, whichever block is in use."""

    def __init__(self, block: Callable[[], SharedBlock | None], slot: int) -> None:
        self._block = block
        self._place = Slot.BEATS + slot

    def beat(self, time_ns: int) -> None:
        """The device was alive at `time_ns` of the cell's clock."""
        if block := self._block():
            block.words[self._place] = time_ns
