"""A Universal Robots arm for campaigns: moves, searches for contact, currents, tables that this computer holds."""

from __future__ import annotations

import asyncio
import math
import re
from collections.abc import AsyncIterator, Callable, Iterator, Mapping, Sequence
from contextlib import asynccontextmanager, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean, stdev
from typing import Final, final

from cellctl.clock import Clock, DelayFit, MinimumDelayFit
from cellctl.devices import (
    ArmRows,
    CommissioningStep,
    DeviceError,
    DeviceFault,
    DeviceLost,
    DeviceRefused,
    DeviceUncertain,
    Health,
    HostTables,
    HostTableStore,
    Identity,
    JointReadings,
    LimitExceeded,
    MotorCurrents,
    SearchEnd,
    SearchResult,
)
from drivers.seen_through import see_through
from drivers.ur_rtde.commissioning import WatchedData, steps_of
from drivers.ur_rtde.dashboard import Dashboard
from drivers.ur_rtde.jobs import Job, Jobs, Outcome, refusal
from drivers.ur_rtde.kinematics_info import Calibration, read_calibration
from drivers.ur_rtde.line import RtdeLine
from drivers.ur_rtde.settings import FASTEST_DEG_S, UrLimits, UrPlace
from drivers.ur_rtde.state import Sample

AXES = 6
_MOVE_HZ = 50.0
_ALL_OF_IT_S = 3600.0
"""No search takes longer: the fit forgets nothing of it."""

_FULL_TURNS_DEG = 363.0
"""The joints turn by ± 363° (PolyScope's default limits)."""

_ARRIVED_DEG = 0.05
_END_DEG = 0.3
"""A search without contact rests within this of the end of its line, norm of the joint vector."""

_BESIDES_S = 15.0
_AGAIN_S = 4.0
"""For a stop over a second connection."""

_LOOK_S = 0.02
LOCAL = "the pendant is in local control"
_CONDITIONS: Final = {"ready": "robot and safety are in order, and the resident program runs"}


def _nothing(*_: object) -> None:
    """Watches nothing, keeps nothing."""


@final
@dataclass(frozen=True, slots=True)
class TablePlace:
    """The folder of the tables that this computer holds, and the largest correction of a joint, deg."""

    folder: Path
    correction_deg: float

    def of(self, device: str, serial: str, calibration: str) -> HostTables:
        """The tables of the controller of this serial number, which computes with this calibration."""
        file = self.folder / f"{re.sub(r'[^A-Za-z0-9-]', '_', serial) or 'none'}.json"
        return HostTables(device, file, serial, calibration, self.correction_deg)


@final
class LastBeat:
    """The last proof of life of another device: a Guard."""

    def __init__(self) -> None:
        self.time_ns = 0

    def beat(self, time_ns: int) -> None:
        """The device was alive at `time_ns` of the cell's clock."""
        self.time_ns = time_ns


def _clock_of(samples: Sequence[Sample]) -> DelayFit:
    """The controller's own clock, fitted to the samples with the least delay."""
    fit = MinimumDelayFit(_ALL_OF_IT_S)
    for sample in samples:
        fit.add(_stamp_ns(sample), sample.arrival_ns)
    return fit.fit()


def _stamp_ns(sample: Sample) -> int:
    return round(sample.time_s * 1e9)


@final
class UrRobot(HostTableStore):
    """A Universal Robots arm by its resident program: a CompensatedRobot, CurrentSource, CalibratedArm and Conditions.

    `host_tables`: of no controller until it is connected.
    """

    def __init__(
        self, name: str, place: UrPlace, digest: tuple[int, int], clock: Clock, limits: UrLimits, tables: TablePlace
    ) -> None:
        self.name = name
        self.host_tables = tables.of(name, "", "")
        self._tables = tables
        self._clock, self._limits, self._place, self._digest = clock, limits, place, digest
        self._identity: Identity | None = None
        self._calibration: Calibration | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._guards: dict[str, LastBeat] = {}
        self._stop = False
        self._stopped_ns: int | None = None
        self._busy = False
        self._asking = asyncio.Lock()
        self._fresh(adrift=False)

    def _fresh(self, *, adrift: bool) -> None:
        """New lines. adrift: a motion was given by the old ones, and its end is not confirmed yet."""
        place = self._place
        self._line = RtdeLine(self.name, (place.host, place.port), self._clock)
        self._dashboard = Dashboard(self.name, (place.host, place.dashboard), self._clock)
        self._jobs = Jobs(self.name, self._clock, self._line, self._digest)
        self._jobs.adrift = adrift
        self._search_clock: DelayFit | None = None

    @property
    def axes(self) -> int:
        """Six."""
        return AXES

    # the line

    async def connect(self) -> Identity:
        """Connect and read the identity; nothing moves. Raises DeviceUnreachable, DeviceRefused, DeviceLost."""
        if self._identity:
            return self._identity
        self._loop = asyncio.get_running_loop()
        self._fresh(adrift=self._jobs.adrift)
        try:
            wire = await self._line.open()
            await self._dashboard.open(wire)
            await self._jobs.open()
            self._jobs.set_stop(stop=self._stop)
            identity = await self._read_identity()
            self._calibration = await read_calibration(self.name, self._place.host, self._clock, wire)
            self.host_tables = self._tables.of(self.name, identity.serial, self._calibration.digest)
            self._identity = identity
        except BaseException:
            await see_through(self._hang_up())
            raise
        return self._identity

    async def close(self) -> None:
        """Stop the robot and close the lines."""
        with suppress(DeviceError):
            await self.stop()
        self._identity = None
        await see_through(self._hang_up())

    async def health(self) -> Health:
        """Modes and program as the controller reports them; counts since `connect`. Raises DeviceLost.

        `latency_ms`: of a question to the Dashboard server. Clock figures: of the last search.
        """
        found = self._jobs.obstacles(await self._sample())
        asked_ns = self._clock.now_ns()
        local = await self._is_local()
        figures = {"latency_ms": (self._clock.now_ns() - asked_ns) * 1e-6}
        figures |= {"skipped": float(self._line.skipped), "stale": float(self._line.stale)}
        if fit := self._search_clock:
            figures |= {"clock_offset_ms": fit.offset_ns * 1e-6, "clock_drift_ppm": fit.drift * 1e6}
            figures["clock_sigma_ms"] = fit.sigma_ns * 1e-6
        found += [LOCAL] if local else []
        mode = "local" if local else "remote"
        return Health(not found, "; ".join(found) or "running, resident program runs", figures, mode)

    def conditions(self) -> Mapping[str, str]:
        """The conditions that an interlock can name."""
        return _CONDITIONS

    async def holds(self, condition: str) -> bool:
        """Whether a condition holds. Raises DeviceLost, KeyError."""
        if condition not in _CONDITIONS:
            raise KeyError(condition)
        return not await self._obstacles()

    async def arm_rows(self) -> ArmRows:
        """The rows that the controller computes with, as it stated them when it was connected. Raises DeviceLost."""
        if self._identity is None or self._calibration is None:
            raise DeviceLost(self.name, "is not connected")
        return self._calibration.rows

    # motion

    async def joints(self) -> JointReadings:
        """Actual joints now, degrees. Raises DeviceLost."""
        return (await self._sample()).joints

    async def move(self, target: JointReadings, speed_percent: float) -> JointReadings:
        """Point to point, planned by the controller; returns the actual joints on arrival, degrees."""
        self._check_joints(target)
        if not 0 < speed_percent <= self._limits.speed_percent:
            what = f"move: speed {speed_percent:g} % is not within 0 … {self._limits.speed_percent:g} %"
            raise LimitExceeded(self.name, what, "The upper limit is speed_percent in the cell file.")
        async with self._held_in_trouble():
            await self._refuse_local()
            self._jobs.set_stop(stop=False)  # a stop that was set before is one of searches; one from now on counts
            here = (await self._sample_now()).joints
            speed = FASTEST_DEG_S * speed_percent / 100
            farthest = max(abs(a - b) for a, b in zip(target, here, strict=True))
            job = Job(1, tuple(target), math.radians(speed))
            last = await self._jobs.run(job, _MOVE_HZ, 2 * farthest / speed + _BESIDES_S, _nothing, _nothing)
            if last.outcome != Outcome.ARRIVED:
                raise refusal(self.name, last.outcome, "move")
            away = max(abs(a - b) for a, b in zip(last.joints, target, strict=True))
            if away > _ARRIVED_DEG:
                raise DeviceFault(self.name, f"move: the robot stands {away:.2f} deg away from the target")
            return last.joints

    async def search(
        self, end: JointReadings, speed_deg_s: float, guards: dict[str, float] | None = None
    ) -> SearchResult:
        """Go along the joint-space line to `end` until contact, `stop_now`, the end, or trouble; see SearchingRobot."""
        self._check_joints(end)
        if not 0 < speed_deg_s <= self._limits.speed_deg_s:
            what = f"search: speed {speed_deg_s:g} deg/s is not within 0 … {self._limits.speed_deg_s:g}"
            raise LimitExceeded(self.name, what, "The upper limit is speed_deg_s in the cell file.")
        async with self._held_in_trouble():
            await self._refuse_local()
            self._jobs.set_stop(stop=self._stop)
            start = (await self._sample_now()).joints
            length = math.dist(start, end)
            if not 0 < length <= self._limits.travel_deg:
                what = f"search: {length:.2f} deg is not within 0 … {self._limits.travel_deg:g} deg"
                raise LimitExceeded(self.name, what, "The upper limit is travel_deg in the cell file.")
            samples: list[Sample] = []
            skipped = self._line.skipped
            watch = self._watch(guards or {})
            job = Job(2, tuple(end), math.radians(speed_deg_s))
            limit_s = 2 * length / speed_deg_s + _BESIDES_S
            last = await self._jobs.run(job, self._line.rate_hz, limit_s, samples.append, watch)
            return self._result(samples, last, end, self._line.skipped - skipped)

    def stop_now(self) -> None:
        """Stop this search and every later motion, until `clear_stop`; safe from any thread, never blocks."""
        self._stop = True
        if self._stopped_ns is None:
            self._stopped_ns = self._clock.now_ns()
        if self._loop:
            with suppress(RuntimeError):  # the loop is closed: the program stops by the missing beat
                self._loop.call_soon_threadsafe(self._put_stop)

    def clear_stop(self) -> None:
        """Clear the stop."""
        self._stop, self._stopped_ns = False, None
        self._jobs.set_stop(stop=False)

    async def stop(self) -> None:
        """Hold the robot in any state. Raises DeviceUncertain if the controller does not confirm it."""
        self.stop_now()
        if not await see_through(self._halt()):
            raise self._uncertain("")

    def guard(self, name: str) -> LastBeat:
        """The slot for the proof of life of `name`."""
        return self._guards.setdefault(name, LastBeat())

    # currents

    async def currents(self, samples: int) -> MotorCurrents:
        """Mean of `samples` samples of the joints' currents, amperes, at rest; see CurrentSource."""
        if samples < 1:
            raise ValueError(f"{samples} samples of motor currents")
        taken: list[Sample] = []
        with self._one_at_a_time():
            async with self._line.streaming(self._line.rate_hz, taken.append):
                while len(taken) < samples:
                    await self._line.next(1.0)
        used = taken[-samples:]
        if found := [what for sample in used for what in sample.obstacles()]:
            raise DeviceFault(self.name, f"motor currents: {found[0]}")
        columns = list(zip(*(sample.currents for sample in used), strict=True))
        sigmas = tuple(stdev(column) if len(column) > 1 else 0.0 for column in columns)
        middle_ns = (used[0].arrival_ns + used[-1].arrival_ns) // 2
        return MotorCurrents(tuple(map(fmean, columns)), sigmas, samples, middle_ns)

    # commissioning

    def commissioning(self) -> tuple[CommissioningStep, ...]:
        """Data at rest; the probe's wire, where there is one; a tenth of a degree of each axis; stops."""
        return steps_of(self, self._clock, self._place.contact_input)

    async def watch_data(self, seconds: float) -> WatchedData:
        """All packages of so many seconds, at rest. Raises DeviceLost, DeviceRefused."""
        samples: list[Sample] = []
        skipped, stale = self._line.skipped, self._line.stale
        with self._one_at_a_time():
            async with self._line.streaming(self._line.rate_hz, samples.append):
                until = self._clock.now() + seconds
                while self._clock.now() < until:
                    await self._line.next(1.0)
        missed = (self._line.skipped - skipped, self._line.stale - stale)
        return WatchedData(samples, *missed, self._line.rate_hz, _clock_of(samples))

    async def contact_seen(self, *, closed: bool, limit_s: float) -> bool:
        """Wait until the contact input is closed, or is not; whether it was within the limit, s."""
        with self._one_at_a_time():
            async with self._line.streaming(_MOVE_HZ):
                until = self._clock.now() + limit_s
                while self._clock.now() < until:
                    if self._wired(await self._line.next(1.0)) is closed:
                        return True
        return False

    def searching(self) -> bool:
        """Whether a search goes along its line."""
        sample = self._line.recent() if self._busy else None
        return sample is not None and not sample.stands

    # internal

    def _wired(self, sample: Sample) -> bool:
        """Whether the contact input is closed."""
        contact, level = self._place.contact_input, self._place.contact_level
        return contact is not None and bool(sample.inputs >> contact & 1) == level

    def _put_stop(self) -> None:
        """In the loop; a stop that was cleared meanwhile is none."""
        if self._stop:
            self._jobs.set_stop(stop=True)

    async def _read_identity(self) -> Identity:
        serial = (await self._dashboard.ask("get serial number")).split()[-1]
        model = (await self._dashboard.ask("get robot model")).split()[-1]
        version = await self._dashboard.ask("PolyscopeVersion")
        return Identity(self.name, serial, f"Universal Robots {model}", version, "simulated" in version)

    async def _hang_up(self) -> None:
        await self._dashboard.close()
        await self._line.close()

    async def _sample(self) -> Sample:
        """One sample; while a motion streams, its last one."""
        while self._line.streams:
            if sample := self._line.recent():
                return sample
            await self._clock.sleep(_LOOK_S)
        return await self._sample_now()

    async def _sample_now(self) -> Sample:
        async with self._line.streaming(self._line.rate_hz):
            return await self._line.next(1.0)

    async def _obstacles(self) -> list[str]:
        """Each reason against a motion; empty if there is none."""
        found = self._jobs.obstacles(await self._sample())
        return [*found, LOCAL] if await self._is_local() else found

    async def _refuse_local(self) -> None:
        if await self._is_local():
            raise DeviceRefused(self.name, LOCAL, "Choose remote control at the pendant, and start the program.")

    async def _is_local(self) -> bool:
        """CB3 has no such mode, and does not know the question."""
        async with self._asking:
            return await see_through(self._dashboard.ask("is in remote control")) == "false"

    def _watch(self, guards: Mapping[str, float]) -> Callable[[], None]:
        def watch() -> None:
            now = self._clock.now_ns()
            for name, oldest_s in guards.items():
                age_s = (now - self.guard(name).time_ns) * 1e-9
                if age_s > oldest_s:
                    self._jobs.set_stop(stop=True)
                    what = f"no sign of life for {age_s:.3f} s ({oldest_s:g} s allowed); the robot is held"
                    raise DeviceLost(name, what, "Look at the device, its line, and what else runs on this computer.")

        return watch

    def _result(self, samples: list[Sample], last: Sample, end: JointReadings, skipped: int) -> SearchResult:
        if last.outcome not in (Outcome.CONTACT, Outcome.STOPPED, Outcome.TRAVEL):
            raise refusal(self.name, last.outcome, "search")
        travel = last.outcome == Outcome.TRAVEL
        short = math.dist(last.joints, end)
        if travel and short > _END_DEG:
            raise DeviceFault(self.name, f"search: the robot rests {short:.2f} deg from the end of the line")
        clock = self._search_clock = _clock_of(samples)
        return SearchResult(
            end=SearchEnd.TRAVEL if travel else SearchEnd.STOPPED,
            times_ns=tuple(clock.to_cell_ns(_stamp_ns(sample)) for sample in samples),
            joints=tuple(sample.joints for sample in samples),
            resting=last.joints,
            stop_cycles=self._stop_cycles(samples),
            late=0,
            lost=0,
            skipped=skipped,
        )

    def _stop_cycles(self, samples: list[Sample]) -> int:
        """Samples from the first with the stop known, by the wire or from this computer, to the first at rest."""
        for first, sample in enumerate(samples):
            told = self._stopped_ns is not None and sample.arrival_ns >= self._stopped_ns
            if told or self._wired(sample):
                return next((n for n, after in enumerate(samples[first:]) if after.stands), len(samples) - first)
        return 0

    def _check_joints(self, joints: JointReadings) -> None:
        if len(joints) != AXES or not all(map(math.isfinite, joints)):
            raise LimitExceeded(self.name, f"{joints} are not {AXES} joint readings")
        for axis, angle in enumerate(joints, 1):
            if abs(angle) > _FULL_TURNS_DEG:
                raise LimitExceeded(self.name, f"A{axis} {angle:.3f} deg is outside ±{_FULL_TURNS_DEG:g} deg")

    async def _halt(self) -> bool:
        """Stop what moves; where the line is gone, by a new one: the program also stops by the missing beat."""
        if await self._jobs.halt():
            return True
        if self._line.error() is None:
            return False
        await self._hang_up()
        line = RtdeLine(self.name, (self._place.host, self._place.port), self._clock)
        with suppress(DeviceError, TimeoutError):
            try:
                async with self._clock.timeout(_AGAIN_S):
                    await line.open()
                    self._jobs.adrift = not await self._jobs.halted_over(line)
            finally:
                await line.close()
        return not self._jobs.adrift

    @asynccontextmanager
    async def _held_in_trouble(self) -> AsyncIterator[None]:
        """One motion at a time; halts the robot unless the controller itself reported the end of the motion."""
        with self._one_at_a_time():
            if self._jobs.adrift and not await see_through(self._halt()):
                raise self._uncertain("it was not confirmed before either; nothing was begun")
            try:
                yield
            except BaseException as error:
                if self._jobs.adrift:
                    self.stop_now()
                    if not await see_through(self._halt()) and isinstance(error, Exception):
                        raise self._uncertain(error.what if isinstance(error, DeviceError) else str(error)) from error
                raise

    @contextmanager
    def _one_at_a_time(self) -> Iterator[None]:
        if self._busy:
            raise DeviceRefused(self.name, "another command is under way")
        self._busy = True
        try:
            yield
        finally:
            self._busy = False

    def _uncertain(self, cause: str) -> DeviceUncertain:
        what = "the controller has not confirmed that the robot stands: it may still be moving"
        cure = "Keep away from it, stop it at the pendant, then look at the network."
        return DeviceUncertain(self.name, f"{what} ({cause})" if cause else what, cure)
