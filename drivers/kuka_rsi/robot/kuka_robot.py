"""The robot for campaigns: moves by the controller, searches by RSI, held after each motion; currents, health."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from statistics import fmean, stdev
from typing import Final, final

from cellctl.clock import Clock
from cellctl.devices import (
    TABLE_CORRECTION_DEG,
    CommissioningStep,
    ControllerTable,
    CorrectionModel,
    CorrectionReport,
    CorrectionSample,
    DeviceError,
    DeviceFault,
    DeviceLost,
    DeviceRefused,
    Guard,
    Health,
    Identity,
    JointReadings,
    LimitExceeded,
    MotorCurrents,
    SearchResult,
    TableState,
    refuse_corrections,
)
from drivers.kuka_rsi import AXES
from drivers.kuka_rsi.cyclic.limits import OnlineLimits, SearchLimits
from drivers.kuka_rsi.cyclic.session import Phase, SearchOrder
from drivers.kuka_rsi.cyclic.shared_block import Sample, Slot
from drivers.kuka_rsi.eki.channel import Reply, point_to_point, refusal
from drivers.kuka_rsi.eki.tables import TableChannel, to_row
from drivers.kuka_rsi.robot.commissioning import WatchedSession, steps_of
from drivers.kuka_rsi.robot.correcting import Correcting
from drivers.kuka_rsi.robot.holding import Holding
from drivers.kuka_rsi.robot.lines import ENGINE, ControllerLines, GuardSlots
from drivers.kuka_rsi.robot.searching import Search, foreign_datagrams
from drivers.kuka_rsi.settings import RsiSettings
from drivers.seen_through import see_through

AT_REST = (0.0,) * AXES
"""The correction of a session at rest. Its speed is stated as 1 deg/s: no speed is used, but times divide by it."""

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

_SLOW_AXIS_DEG_S = 30.0
"""Below the speed of any axis of a KUKA six-axis arm at 100 %; a move's time limit, twice the way at it, follows."""

_SLOWEST_PERCENT = 0.01
"""Below this a move would last for hours; the controller refuses it too."""

_FARTHEST_DEG = 720.0
"""Largest rotation of an axis in a move whose target only the controller has: from one end of A6 (±350 deg) to the
other is 700.
"""

_MOVE_BESIDES_S = 15.0
"""Cell time of a move besides its way at the slowest axis' speed: ramps, brakes, the controller's own checks."""

_CONDITIONS: Final = {"ready": "the controller is in EXT and reports no message that stops it"}


def mean_currents(device: str, samples: Sequence[Sample]) -> MotorCurrents:
    """Mean and 1 σ of one sample, in the unit of MACur. Raises DeviceFault if a telegram has no six numbers."""
    if not all(sample.currents for sample in samples):
        cure = "compare the RSI Ethernet configuration on the controller with the one here"
        raise DeviceFault(device, "telegrams came without readable motor currents (MACur)", cure)
    columns = list(zip(*(sample.currents for sample in samples), strict=True))
    sigmas = tuple(stdev(column) if len(column) > 1 else 0.0 for column in columns)
    middle_ns = (samples[0].arrival_ns + samples[-1].arrival_ns) // 2
    return MotorCurrents(tuple(map(fmean, columns)), sigmas, len(samples), middle_ns)


def health_of(lines: ControllerLines) -> Health:
    """State of controller and RSI process; counts since the lines were opened. Raises DeviceLost."""
    process, eki = lines.process, lines.eki
    stat = eki.stat
    words = process.block.words
    figures = {slot.name.lower(): float(words[slot]) for slot in _COUNTED}
    figures |= {"cycle_ms": words[Slot.CYCLE] * 1e-6, "real_time": float(process.granted["fifo"])}
    figures |= {"memory_locked": float(process.granted["mlock"]), "pinned": float(process.granted["affinity"])}
    figures |= {"unreadable": float(eki.unreadable), "latency_ms": lines.latency_s * 1e3}
    text = f"{stat.mode}, {stat.program}" + (f": {stat.message}" if stat.message else "")
    text += "".join(f"; {what}" for name, what in _WITHOUT.items() if not process.granted[name])
    if words[Slot.FOREIGN]:
        text += f"; {foreign_datagrams(process)}"
    return Health(stat.program != "ERROR" and stat.mode == "EXT", text, figures, stat.mode)


@final
class KukaRobot:
    """A KUKA robot: RSI in a separate process, EthernetKRL for the rest.

    A CompensatedRobot, CorrectingRobot, CurrentSource, Listener and Commissioned.
    """

    def __init__(
        self,
        name: str,
        settings: RsiSettings,
        clock: Clock,
        limits: SearchLimits,
        online: OnlineLimits | None = None,
        table_correction_deg: float = TABLE_CORRECTION_DEG,
    ) -> None:
        self.name = name
        self._clock = clock
        self._limits = limits
        self._table_correction_deg = table_correction_deg
        self._configuration = str(settings.ethernet)
        self._mode = settings.mode
        online = online or OnlineLimits()
        self._lines = ControllerLines(name, settings, clock, limits, online)
        self._holding = Holding(name, self._lines)
        self._correcting = Correcting(name, clock, self._lines, self._holding, online)
        self._guards = GuardSlots(name, lambda: self._lines.block)

    @property
    def axes(self) -> int:
        """Six: what a telegram carries."""
        return AXES

    # the line

    async def connect(self) -> Identity:
        """Start the RSI process, open the EthernetKRL channel and ask for the identity.

        Raises DeviceRefused (errors in the Ethernet configuration, a program with another mode or cycle in RSI_ON),
        DeviceUnreachable (port taken, no controller), DeviceFault (the controller shows a message). This needs no
        telegram, and nothing moves.
        """
        return self._lines.identity or await self._lines.open(self.guard(ENGINE), self._holding.keep_stop)

    async def close(self) -> None:
        """Stop the robot, end the process, close the lines."""
        with suppress(DeviceError):
            await self.stop()
        await see_through(self._lines.close())

    def listening(self) -> tuple[str, int]:
        """Host and port bound for the controller's telegrams. Raises DeviceLost before `connect`."""
        return self._lines.process.listening

    async def health(self) -> Health:
        """State of controller and cyclic process; counts since `connect`. Raises DeviceLost."""
        return health_of(self._lines)

    def conditions(self) -> Mapping[str, str]:
        """The conditions that an interlock can name."""
        return _CONDITIONS

    async def holds(self, condition: str) -> bool:
        """Whether a condition holds, by the controller's last report. Raises DeviceLost, KeyError."""
        if condition not in _CONDITIONS:
            raise KeyError(condition)
        return (await self.health()).ok

    async def reset(self) -> None:
        """Acknowledge messages and select the program again. Raises DeviceRefused, DeviceFault, DeviceLost."""
        self._correcting.is_on()  # one that a message ended is off after it, too
        reply = await self._lines.eki.ask("RESET")
        if reply.code:
            raise refusal(self.name, reply, "reset")

    # motion

    async def joints(self) -> JointReadings:
        """Actual joints now, degrees. Raises DeviceLost."""
        reply = await self._lines.eki.ask("HELLO")
        return reply.joints or self._lines.eki.latest_joints

    async def move(self, target: JointReadings, speed_percent: float) -> JointReadings:
        """Point to point, planned by the controller; returns the actual joints on arrival, degrees."""
        self._check_joints(target)
        self._check_speed(speed_percent)
        async with self._holding.held_in_trouble():
            self._check_correction()
            here = self._lines.eki.latest_joints
            farthest = max(abs(a - b) for a, b in zip(target, here, strict=True))
            return await self._transfer("PTP", point_to_point(target, speed_percent), farthest, speed_percent)

    async def move_to_row(self, row: int, speed_percent: float) -> JointReadings:
        """Point to point to row `row` (from 1) of the active table; returns the actual joints on arrival, degrees."""
        self._check_speed(speed_percent)
        async with self._holding.held_in_trouble():
            self._check_correction()
            return await self._transfer("PTPT", to_row(row, speed_percent), _FARTHEST_DEG, speed_percent)

    async def search(
        self, end: JointReadings, speed_deg_s: float, guards: dict[str, float] | None = None
    ) -> SearchResult:
        """Go along the joint-space line to `end` until `stop_now`, the end, or trouble; see SearchingRobot."""
        self._check_joints(end)
        async with self._holding.held_in_trouble():
            start = self._lines.eki.latest_joints
            correction = tuple(b - a for a, b in zip(start, end, strict=True))
            if passed := self._limits.passed_by(correction, speed_deg_s):
                raise LimitExceeded(self.name, f"search: {', '.join(passed)}")
            if not speed_deg_s > 0:
                raise LimitExceeded(self.name, f"search: speed {speed_deg_s:g} deg/s is not positive")
            oldest = self._guards.oldest_ns(guards or {})
            with self._ordered(SearchOrder(self._holding.search, start, correction, speed_deg_s, oldest)) as search:
                return await search.run()

    async def currents(self, samples: int) -> MotorCurrents:
        """Mean of `samples` telegrams' motor currents (MACur) in an RSI session at rest; see CurrentSource.

        Nothing moves: the correction is 0 throughout. As in a search the brakes are open. Raises also DeviceRefused (no
        MACur in the RSI Ethernet configuration, a stop is set).
        """
        if samples < 1:
            raise ValueError(f"{samples} samples of motor currents")
        if self._lines.connected and not self._lines.sends_currents:
            what = f"{self._configuration} has no motor currents in its telegrams"
            cure = 'add <ELEMENT TAG="DEF_MACur" TYPE="DOUBLE" INDX="INTERNAL"/> to SEND, here and on the controller'
            raise DeviceRefused(self.name, what, cure)
        async with self._holding.held_in_trouble():
            here, oldest = self._lines.eki.latest_joints, self._guards.oldest_ns({})
            with self._ordered(SearchOrder(self._holding.search, here, AT_REST, 1.0, oldest, samples)) as search:
                return mean_currents(self.name, (await search.at_rest()).samples[-samples:])

    def stop_now(self) -> None:
        """Stop this search and every later one, until `clear_stop`; safe from any thread, never blocks."""
        self._holding.stop_now()

    def clear_stop(self) -> None:
        """Clear the stop."""
        self._holding.clear_stop()

    async def stop(self) -> None:
        """Hold the robot in any state. Raises DeviceUncertain if the controller does not confirm it."""
        await self._holding.stop()

    def guard(self, name: str) -> Guard:
        """The slot for the proof of life of `name`. Raises ValueError if all are taken."""
        return self._guards.guard(name)

    # commissioning

    @property
    def slow_mode(self) -> str:
        """T1."""
        return "T1"

    def commissioning(self) -> tuple[CommissioningStep, ...]:
        """Telegrams at rest; a tenth of a degree of each axis; stops of a slow search."""
        return steps_of(self, self._clock)

    async def watch_telegrams(self, seconds: float) -> WatchedSession:
        """An RSI session at rest, of so many seconds at least: the correction is 0 throughout.

        Raises as `search`; DeviceRefused if a stop is set.
        """
        async with self._holding.held_in_trouble():
            here, oldest = self._lines.eki.latest_joints, self._guards.oldest_ns({})
            process = self._lines.process
            count = math.ceil(seconds * 1e3 / process.cycle.milliseconds)
            with self._ordered(SearchOrder(self._holding.search, here, AT_REST, 1.0, oldest, count)) as search:
                record = await search.at_rest()
                block = process.block
                status = block.status()
                return WatchedSession(
                    len(record.samples), record.counts(), record.delays_ns(status), status.cycle_ns, block.session()
                )

    def searching(self) -> bool:
        """Whether the set-point of a search goes along its line. Raises DeviceLost."""
        status = self._lines.process.block.status()
        return status.number == self._holding.search and status.phase is Phase.MOVING

    # on-line correction

    async def correction_on(self, model: CorrectionModel) -> None:
        """RSI on beside the program's motions, corrected by `model` in every cycle; see CorrectingRobot."""
        async with self._holding.held_in_trouble():
            order = SearchOrder(
                self._holding.search, self._lines.eki.latest_joints, AT_REST, 1.0, self._guards.oldest_ns({})
            )
            await self._correcting.begin(order, model, self._mode)

    def replace_correction_model(self, model: CorrectionModel) -> None:
        """Correct by another model from now on; see CorrectingRobot."""
        self._correcting.replace(model)

    async def correction_off(self) -> CorrectionReport:
        """Let the correction fade to zero, then RSI off; see CorrectingRobot."""
        if self._holding.correcting:
            self._correcting.fade()
        await self._holding.until_free(self._clock)
        async with self._holding.held_in_trouble():
            return await self._correcting.end()

    def correction_id(self) -> str:
        """The id of the model in force; see CorrectingRobot."""
        return self._correcting.model_id if self._correcting.is_on() else ""

    async def programmed_joints(self) -> JointReadings:
        """Where its own program has the robot; see CorrectingRobot."""
        return self._correcting.programmed() or await self.joints()

    def correction_samples(self) -> tuple[CorrectionSample, ...]:
        """The samples since the last call; see CorrectingRobot."""
        return self._correcting.samples()

    async def run_program(self, number: int, limit_s: float) -> JointReadings:
        """Run the controller's own program `number`; see CorrectingRobot."""
        async with self._holding.held_in_trouble():
            self._check_correction()
            pending = await self._lines.eki.send("OWN", f'<Row N="{number}"/>')
            try:
                joints = self._arrived(await pending.reply(limit_s))
            except TimeoutError:
                raise DeviceLost(self.name, f"program {number} did not end within {limit_s:.0f} s") from None
            self._check_correction()  # again: the program may have run to its end without the correction
            return joints

    # compensation tables

    async def push_table(self, table: ControllerTable) -> TableState:
        """Stage, read back, compare, activate at once; see TableStore."""
        for row in table.rows:
            self._check_joints(row.nominal)
            self._check_joints(row.compensated)
        refuse_corrections(self.name, table, self._table_correction_deg)
        with self._holding.one_at_a_time():
            return await self._tables().push(table)

    async def table_state(self) -> TableState:
        """The controller's tables."""
        return await self._tables().state()

    async def read_table(self) -> ControllerTable | None:
        """The active table as stored on the controller; see TableStore."""
        with self._holding.one_at_a_time():
            return await self._tables().read()

    async def rollback_table(self) -> TableState:
        """Activate the previous table again; see TableStore."""
        with self._holding.one_at_a_time():
            return await self._tables().rollback()

    # internal

    @contextmanager
    def _ordered(self, order: SearchOrder) -> Iterator[Search]:
        """A search of this order; a stop that is set applies to it. The next one has the next number.

        Raises DeviceRefused if an on-line correction is on: RSI has one session at a time.
        """
        if self._holding.correcting:
            raise DeviceRefused(self.name, "an on-line correction is on", "End it first.")
        process, eki = self._lines.process, self._lines.eki
        try:
            yield Search(self.name, self._clock, eki, process, order, self._guards.names, self._configuration)
        finally:
            self._holding.search += 1

    async def _transfer(self, operation: str, content: str, farthest_deg: float, speed_percent: float) -> JointReadings:
        """A move planned by the controller, at most `farthest_deg` in any axis; returns the joints on arrival."""
        limit_s = 2 * farthest_deg / (_SLOW_AXIS_DEG_S * speed_percent / 100) + _MOVE_BESIDES_S
        pending = await self._lines.eki.send(operation, content)
        try:
            return self._arrived(await pending.reply(limit_s))
        except TimeoutError:
            raise DeviceLost(self.name, f"the move of {farthest_deg:.1f} deg did not end in {limit_s:.0f} s") from None

    def _arrived(self, reply: Reply) -> JointReadings:
        if reply.code:
            raise refusal(self.name, reply, "move")
        return reply.joints or self._lines.eki.latest_joints

    def _check_correction(self) -> None:
        """Raise DeviceFault or DeviceLost if an on-line correction is not applied as ordered."""
        if trouble := self._correcting.trouble():
            raise trouble

    def _tables(self) -> TableChannel:
        serial = self._lines.identity.serial if self._lines.identity else ""
        return TableChannel(self.name, self._lines.eki, serial)

    def _check_joints(self, joints: JointReadings) -> None:
        if len(joints) != AXES or not all(map(math.isfinite, joints)):
            raise LimitExceeded(self.name, f"{joints} are not {AXES} joint readings")

    def _check_speed(self, percent: float) -> None:
        if not _SLOWEST_PERCENT <= percent <= 100:
            raise LimitExceeded(self.name, f"move: speed {percent:g} % is not within {_SLOWEST_PERCENT:g} … 100 %")
