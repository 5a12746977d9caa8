"""One motion at a time by the resident program: given, followed, stopped in any doubt."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from enum import IntEnum
from typing import final

from cellctl.clock import Clock
from cellctl.devices import DeviceError, DeviceFault, DeviceLost, DeviceRefused, JointReadings, LimitExceeded
from drivers.ur_rtde.line import RECENT_S, RtdeLine
from drivers.ur_rtde.state import Sample

BEAT_S = 0.02
_LAST_NUMBER = 999_999
_TAKEN_S = 1.0
"""The program takes a job within two cycles."""

_HALT_S = 5.0
"""With a second connection after it, less than the engine waits for a stop (10 s)."""

_LOOK_HZ = 25.0
_REST_S = 3.0
"""More than the longest braking at the program's accelerations."""

_ORDERS = ("input_int_register_25", "input_int_register_26", "input_int_register_27")
_GOAL = tuple(f"input_double_register_{number}" for number in range(24, 31))
_BEAT, _STOP = "input_int_register_24", "input_int_register_28"
_CURE = "Look at the message at the pendant, remove its cause, and start the resident program again."


class Outcome(IntEnum):
    """How the resident program ended a job; its text has the same numbers."""

    ARRIVED = 0
    CONTACT = 1
    TRAVEL = 2
    TOO_FAR = 20
    TOO_FAST = 21
    CHECK = 22
    KIND = 23
    ASIDE = 24
    STOPPED = 30
    SILENT = 31


@final
@dataclass(frozen=True, slots=True)
class Job:
    """A motion: `kind` 1 a move, 2 a search; `goal` in degrees; `speed_rad_s`: of the leading joint, or of the norm."""

    kind: int
    goal: JointReadings
    speed_rad_s: float

    def registers(self, number: int) -> dict[str, int | float]:
        """The registers that order it as job `number`: all are set in one cycle of the controller."""
        goal = tuple(map(math.radians, self.goal))
        parts = (*goal, self.speed_rad_s)
        check = number + 2 * self.kind + sum(w * math.floor(x * 1e6 + 0.5) for w, x in enumerate(parts, 3))
        return dict(zip((*_ORDERS, *_GOAL), (number, self.kind, check, *parts), strict=True))


@final
class Jobs:
    """Gives jobs to the resident program and follows them.

    `adrift`: a motion was started, and its end is not confirmed. `number`: of the last job that this line gave.
    """

    def __init__(self, device: str, clock: Clock, line: RtdeLine, digest: tuple[int, int]) -> None:
        self.adrift = False
        self._device, self._clock, self._line, self._digest = device, clock, line, digest
        self._beat = clock.now_ns() // 1_000_000 % 1_000_000  # not the one that an earlier process ended with
        self._beaten_ns = 0
        self._stop = False
        self.number: int | None = None

    async def open(self) -> None:
        """Reserve the registers. Raises DeviceRefused if another program writes them, DeviceLost."""
        await self._line.reserve("beat", (_BEAT,))
        await self._line.reserve("stop", (_STOP,))
        await self._line.reserve("job", (*_ORDERS, *_GOAL))

    def set_stop(self, *, stop: bool) -> None:
        """Set the stop, or let the next job begin without one; while it is set the program moves nothing.

        Only the next job clears it on the controller: one that was stopped cannot go on. Never raises.
        """
        self._stop = stop
        if stop:
            with suppress(DeviceError, KeyError):
                self._line.write("stop", {_STOP: 1})

    def obstacles(self, sample: Sample) -> list[str]:
        """Each reason against a motion; empty if there is none."""
        found = sample.obstacles()
        if not sample.program_runs:
            found.append("no program runs")
        elif sample.digest != self._digest:
            found.append("the program that runs is not the one that `cellctl krl` writes for this cell")
        return found

    async def run(
        self, job: Job, hz: float, limit_s: float, took: Callable[[Sample], object], watch: Callable[[], None]
    ) -> Sample:
        """Do a job; returns the last sample, of the robot at rest. `took`: gets every sample, from before the motion.

        `watch`: called after every sample of the job in progress; what it raises stops the robot.
        Raises DeviceRefused, LimitExceeded (nothing moved), DeviceFault (the robot stands), DeviceLost (call `halt`).
        """
        async with self._line.streaming(hz, took):
            sample = await self._line.next(RECENT_S)
            if found := self.obstacles(sample):
                raise DeviceRefused(self._device, "; ".join(found), "Remedy this at the pendant, then try again.")
            if sample.taken != sample.ended:
                raise DeviceRefused(self._device, f"the program is still at job {sample.taken}", "Start it again.")
            await self._heard()
            number = sample.taken % _LAST_NUMBER + 1
            self._line.write("stop", {_STOP: int(self._stop)})
            self._give_beat()
            self.adrift, self.number = True, number
            self._line.write("job", job.registers(number))
            sample = await self._follow(number, limit_s, watch)
            ended = self._clock.now()
            while not sample.stands:
                if self._clock.now() - ended > _REST_S:
                    raise DeviceLost(
                        self._device, f"the robot is not at rest {_REST_S:g} s after the end of the motion"
                    )
                sample = await self._line.next(RECENT_S)
            self.adrift = False
            return sample

    async def halt(self) -> bool:
        """Set the stop and wait until the robot stands; returns whether the controller confirmed it."""
        if not self.adrift:
            return True
        self.set_stop(stop=True)
        with suppress(DeviceError, TimeoutError):
            async with self._clock.timeout(_HALT_S), self._line.streaming(_LOOK_HZ):
                sample = await self._line.next(RECENT_S)
                while not self.over(sample):
                    sample = await self._line.next(RECENT_S)
                self.adrift = False
        return not self.adrift

    async def halted_over(self, line: RtdeLine) -> bool:
        """Set the stop by another line, after ours was lost, and wait until the robot stands. Raises DeviceError.

        The register is free, so the controller has closed our line: no job is on its way any more.
        """
        await line.reserve("stop", (_STOP,))
        self.number = None
        line.write("stop", {_STOP: 1})
        async with line.streaming(_LOOK_HZ):
            sample = await line.next(RECENT_S)
            while not self.over(sample):
                sample = await line.next(RECENT_S)
        return True

    def over(self, sample: Sample) -> bool:
        """Whether the robot stands and, with the stop set, no motion of ours can begin or go on.

        Our job has ended, or no program runs: one that is paused goes on to the stop.
        """
        ended = sample.taken == sample.ended and self.number in (None, sample.ended)
        return sample.stands and (ended or not sample.program_runs)

    # internal

    async def _heard(self) -> None:
        """Wait until the program answers a beat. The registers keep the digest of a program that has ended."""
        self._give_beat()
        begun = self._clock.now()
        while (await self._line.next(RECENT_S)).heard != self._beat:
            if self._clock.now() - begun > _TAKEN_S:
                what = "the program that runs does not answer: it is not the one that `cellctl krl` writes"
                raise DeviceRefused(self._device, what, "Start the resident program at the pendant.")

    async def _follow(self, number: int, limit_s: float, watch: Callable[[], None]) -> Sample:
        begun = self._clock.now()
        while True:
            sample = await self._line.next(RECENT_S)
            watch()
            self._beat_if_due()
            if sample.ended == number:
                return sample
            if found := sample.obstacles():
                raise self._stopped_by_itself(", ".join(found))
            if not sample.program_runs:
                raise self._stopped_by_itself("the program was ended")
            waited = self._clock.now() - begun
            if sample.taken != number and waited > _TAKEN_S:
                raise DeviceLost(self._device, f"the program did not take job {number} within {_TAKEN_S:g} s")
            if waited > limit_s:
                raise DeviceLost(self._device, f"the motion did not end in {limit_s:.0f} s")

    def _stopped_by_itself(self, why: str) -> DeviceFault:
        """Loud, and not the end: a robot that brakes still moves, so the caller halts."""
        said = f" ({self._line.messages[-1]})" if self._line.messages else ""
        return DeviceFault(self._device, f"the controller stopped the robot: {why}{said}", _CURE)

    def _beat_if_due(self) -> None:
        if self._clock.now_ns() - self._beaten_ns >= BEAT_S * 1e9:
            self._give_beat()

    def _give_beat(self) -> None:
        self._beat = (self._beat + 1) % 1_000_000
        self._beaten_ns = self._clock.now_ns()
        self._line.write("beat", {_BEAT: self._beat})


def refusal(device: str, outcome: int, what: str) -> DeviceError:
    """The error for an outcome that is none of a search's or move's good ends."""
    match outcome:
        case Outcome.TOO_FAR:
            return LimitExceeded(device, f"{what}: the program refuses the way")
        case Outcome.TOO_FAST:
            return LimitExceeded(device, f"{what}: the program refuses the speed")
        case Outcome.CHECK:
            cure = "Does another program write to these registers?"
            return DeviceFault(device, f"{what}: the job that arrived does not fit its check", cure)
        case Outcome.ASIDE:
            return DeviceFault(device, f"{what}: the joints left the line; the robot is held", _CURE)
        case Outcome.STOPPED:
            return DeviceFault(device, f"{what}: stopped; the robot is held")
        case Outcome.SILENT:
            return DeviceLost(device, f"{what}: the program heard nothing from this computer; the robot is held")
    return DeviceFault(device, f"{what}: ended with the unknown outcome {outcome}", _CURE)
