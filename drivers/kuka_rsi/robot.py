"""The robot as campaigns know it: moves by the controller, searches by RSI, always held."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator, Iterator, Mapping
from contextlib import asynccontextmanager, contextmanager, suppress
from typing import Final, final

from cellctl.clock import Clock
from cellctl.devices import (
    ControllerTable,
    DeviceError,
    DeviceFault,
    DeviceLost,
    DeviceRefused,
    DeviceUncertain,
    Guard,
    Health,
    Identity,
    JointReadings,
    LimitExceeded,
    SearchResult,
    TableState,
)
from drivers.kuka_rsi.eki_channel import EkiChannel
from drivers.kuka_rsi.eki_documents import Reply, point_to_point
from drivers.kuka_rsi.ethernet_config import read_ethernet_config
from drivers.kuka_rsi.guards import ENGINE, GuardSlots
from drivers.kuka_rsi.limits import AXES, SearchLimits
from drivers.kuka_rsi.process import CyclicProcess
from drivers.kuka_rsi.refusals import cure_of, refusal
from drivers.kuka_rsi.search_cycle import SearchOrder
from drivers.kuka_rsi.searching import Search, elsewhere
from drivers.kuka_rsi.seen_through import see_through
from drivers.kuka_rsi.settings import RsiSettings
from drivers.kuka_rsi.shared_block import Slot
from drivers.kuka_rsi.table_channel import TableChannel
from drivers.kuka_rsi.table_rows import to_row
from drivers.kuka_rsi.telegram import ReplyFormat

_COUNTED = (
    Slot.TELEGRAMS,
    Slot.LATE,
    Slot.LATE_REPORTED,
    Slot.LOST,
    Slot.SKIPPED,
    Slot.STALE,
    Slot.BEYOND,
    Slot.MALFORMED,
    Slot.FOREIGN,
)

_WITHOUT = {
    "fifo": "no real-time priority for RSI (grant CAP_SYS_NICE or an rtprio limit)",
    "mlock": "the memory of RSI is not locked (grant CAP_IPC_LOCK or a memlock limit)",
    "affinity": "RSI has no processor of its own (isolcpus)",
}

_CONDITIONS: Final = {"ready": "the controller is in EXT and reports no message that stops it"}

_BEAT_S = 0.05

_SLOW_AXIS_DEG_S = 30.0
"""No axis is slower at 100 %; from it a move's time-out is computed."""

_SLOWEST_PERCENT = 0.01
"""Below this a move would last for hours; the controller refuses it too."""

_FARTHEST_DEG = 720.0
"""No axis turns further in a move whose target only the controller knows."""

_MOVE_BESIDES_S = 15.0
_HALT_S = 10.0


@final
class KukaRobot:
    """A KUKA robot: RSI in a process of its own, EthernetKRL for the rest. A CompensatedRobot, Listener, Conditions."""

    def __init__(self, name: str, settings: RsiSettings, clock: Clock, limits: SearchLimits) -> None:
        self.name = name
        self._settings = settings
        self._clock = clock
        self._limits = limits
        self._eki: EkiChannel | None = None
        self._process: CyclicProcess | None = None
        self._identity: Identity | None = None
        self._beating: asyncio.Task[None] | None = None
        self._search = 1  # number of the one under way, or else of the next
        self._busy = False
        self._adrift = False  # a motion was cut off, and no standstill was confirmed since
        self._guards = GuardSlots(name, lambda: self._process and self._process.block)

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
        with suppress(DeviceError):
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
        figures = {slot.name.lower(): float(words[slot]) for slot in _COUNTED}
        figures |= {"cycle_ms": words[Slot.CYCLE] * 1e-6, "real_time": float(process.granted["fifo"])}
        figures |= {"memory_locked": float(process.granted["mlock"]), "pinned": float(process.granted["affinity"])}
        figures["unreadable"] = float(self._connected_eki().unreadable)
        text = f"{stat.mode}, {stat.program}" + (f": {stat.message}" if stat.message else "")
        text += "".join(f"; {what}" for name, what in _WITHOUT.items() if not process.granted[name])
        if words[Slot.FOREIGN]:
            text += f"; {elsewhere(process)}"
        return Health(stat.program != "ERROR" and stat.mode == "EXT", text, figures)

    def conditions(self) -> Mapping[str, str]:
        """What an interlock can name."""
        return _CONDITIONS

    async def holds(self, condition: str) -> bool:
        """Whether a condition holds, by the controller's last report. Raises DeviceLost, KeyError."""
        if condition not in _CONDITIONS:
            raise KeyError(condition)
        return (await self.health()).ok

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
        self._check_speed(speed_percent)
        async with self._held_in_trouble():
            here = self._connected_eki().latest_joints
            farthest = max(abs(a - b) for a, b in zip(target, here, strict=True))
            return await self._transfer("PTP", point_to_point(target, speed_percent), farthest, speed_percent)

    async def move_to_row(self, row: int, speed_percent: float) -> JointReadings:
        """Point to point to row `row` (from 1) of the active table; returns the actual joints on arrival, degrees."""
        self._check_speed(speed_percent)
        async with self._held_in_trouble():
            return await self._transfer("PTPT", to_row(row, speed_percent), _FARTHEST_DEG, speed_percent)

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
            oldest = self._guards.oldest_ns(guards or {})
            order = SearchOrder(self._search, start, correction, speed_deg_s, oldest)
            process.block.keep_stop(order.number)
            names, file = self._guards.names, str(self._settings.ethernet)
            try:
                return await Search(self.name, self._clock, eki, process, order, names, file).run()
            finally:
                self._search += 1

    def stop_now(self) -> None:
        """Stop this search and every later one, until `clear_stop`; safe from any thread, never blocks."""
        if process := self._process:
            process.block.words[Slot.STOP] = self._search

    def clear_stop(self) -> None:
        """Forget the stop that stands."""
        if process := self._process:
            process.block.words[Slot.STOP] = 0

    async def stop(self) -> None:
        """Hold the robot whatever it does. Raises DeviceUncertain where the controller does not confirm it."""
        self.stop_now()
        if not self._stands() and not await see_through(self._halt()):
            raise DeviceUncertain(
                self.name,
                "the controller has not confirmed that the robot stands: it may still be moving",
                "Keep away from it, stop it at the pendant, then look at the EthernetKRL line.",
            )

    def guard(self, name: str) -> Guard:
        """The slot in which `name`'s proof of life is left. Raises ValueError where all are taken."""
        return self._guards.guard(name)

    # compensation tables

    async def push_table(self, table: ControllerTable) -> TableState:
        """Stage, read back, compare, activate at once; see TableStore."""
        for row in table.rows:
            self._check_joints(row.nominal)
            self._check_joints(row.compensated)
        with self._one_at_a_time():
            return await self._tables().push(table)

    async def table_state(self) -> TableState:
        """What tables the controller has."""
        return await self._tables().state()

    async def read_table(self) -> ControllerTable | None:
        """The active table as the controller holds it; see TableStore."""
        with self._one_at_a_time():
            return await self._tables().read()

    async def rollback_table(self) -> TableState:
        """Put the table before into force again; see TableStore."""
        with self._one_at_a_time():
            return await self._tables().rollback()

    # inner works

    async def _start_process(self) -> CyclicProcess:
        config = read_ethernet_config(self._settings)
        if config.mistakes:
            cure = "Correct the file, and load the same one on the controller."
            raise DeviceRefused(self.name, "; ".join(config.mistakes), cure)
        reply = ReplyFormat.of(config.sentype, config.receive, self._settings.correction, self._settings.stop)
        clock = self._clock
        with clock.standing():
            return await CyclicProcess.start(self.name, self._settings, clock.source, reply.template, self._limits)

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
            with self._clock.standing():
                await process.end()

    async def _beat(self) -> None:
        """The engine's own proof of life: where its loop hangs, these stop and the cyclic process holds the robot."""
        guard = self.guard(ENGINE)
        while True:
            guard.beat(self._clock.now_ns())
            await self._clock.sleep(_BEAT_S)

    @contextmanager
    def _one_at_a_time(self) -> Iterator[None]:
        if self._busy:
            raise DeviceRefused(self.name, "another command is under way")
        self._busy = True
        try:
            yield
        finally:
            self._busy = False

    @asynccontextmanager
    async def _held_in_trouble(self) -> AsyncIterator[None]:
        """One motion at a time; where it ends otherwise than by the controller's own word, the robot is halted."""
        with self._one_at_a_time():
            try:
                yield
            except (DeviceRefused, DeviceFault, LimitExceeded):
                raise
            except BaseException:
                self.stop_now()
                await see_through(self._halt())
                raise

    async def _transfer(self, operation: str, content: str, farthest_deg: float, speed_percent: float) -> JointReadings:
        """A move planned by the controller, over at most `farthest_deg` of any axis; the actual joints on arrival."""
        limit_s = 2 * farthest_deg / (_SLOW_AXIS_DEG_S * speed_percent / 100) + _MOVE_BESIDES_S
        pending = await self._connected_eki().send(operation, content)
        try:
            return self._arrived(await pending.reply(limit_s))
        except TimeoutError:
            raise DeviceLost(self.name, f"the move of {farthest_deg:.1f} deg did not end in {limit_s:.0f} s") from None

    async def _halt(self) -> bool:
        """Ask for standstill and wait for it; whether the controller has confirmed it.

        The search is released only once RSI is known to be off: until then the robot is held where it is.
        """
        if self._eki and self._process:
            self._adrift = True
            with suppress(DeviceError):
                await self._eki.ask("HALT", timeout_s=_HALT_S)
                self._process.block.release()
                self._adrift = False
        return not self._adrift

    def _stands(self) -> bool:
        """Whether the controller says that nothing moves; where it was lost, nobody says it."""
        if self._eki is None:
            return True
        with suppress(DeviceLost):
            return not (self._busy or self._adrift or self._eki.stat.program in ("MOVING", "RSI"))
        return False

    def _arrived(self, reply: Reply) -> JointReadings:
        if reply.code:
            raise refusal(self.name, reply, "move")
        return reply.joints or self._connected_eki().latest_joints

    def _tables(self) -> TableChannel:
        serial = self._identity.serial if self._identity else ""
        return TableChannel(self.name, self._connected_eki(), serial)

    def _check_joints(self, joints: JointReadings) -> None:
        if len(joints) != AXES or not all(map(math.isfinite, joints)):
            raise LimitExceeded(self.name, f"{joints} are not {AXES} joint readings")

    def _check_speed(self, percent: float) -> None:
        if not _SLOWEST_PERCENT <= percent <= 100:
            raise LimitExceeded(self.name, f"move: speed {percent:g} % is not within {_SLOWEST_PERCENT:g} … 100 %")

    def _connected_process(self) -> CyclicProcess:
        if self._process is None:
            raise DeviceLost(self.name, "not connected")
        return self._process

    def _connected_eki(self) -> EkiChannel:
        if self._eki is None:
            raise DeviceLost(self.name, "not connected")
        return self._eki
