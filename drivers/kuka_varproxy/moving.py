"""Point-to-point moves by the generated program: one job at a time, stopped when this computer is silent."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import final

from cellctl.clock import Clock
from cellctl.devices import (
    DeviceError,
    DeviceFault,
    DeviceLost,
    DeviceRefused,
    DeviceUncertain,
    JointReadings,
    LimitExceeded,
)
from drivers.kuka_varproxy.readiness import require_ready
from drivers.kuka_varproxy.variables import (
    JOB,
    JOB_KIND,
    SILENCE,
    SILENCE_MS,
    SILENCE_STOPPED,
    STOP,
    Variables,
    structure,
)
from drivers.seen_through import see_through

POLL_S = 0.05
ACTUAL = "$AXIS_ACT_MEAS"

_LAST_NUMBER = 999_999
_HALT_S = 10.0
_SLOW_AXIS_DEG_S = 30.0
"""Least speed of any axis at 100 %; a move's time limit follows from it."""

_BESIDES_S = 15.0
_ARRIVED_DEG = 0.1
_PER_DEG = 10_000
_MESSAGE_CURE = "Look at the message at the pendant, remove its cause, acknowledge it and start the program again."


@final
@dataclass(frozen=True, slots=True)
class Job:
    """A move: to `row` of the active table, or (row 0) to the point; `joints`: where it ends, degrees."""

    joints: JointReadings
    percent: int
    row: int = 0

    def written(self, number: int) -> str:
        """The job's variable: angles in ten-thousandths of a degree, and a check over all of it."""
        angles = (0,) * len(self.joints) if self.row else tuple(round(angle * _PER_DEG) for angle in self.joints)
        values = {"NUMBER": number, "ROW": self.row, "PERCENT": self.percent}
        values |= {f"A{axis}": angle for axis, angle in enumerate(angles, 1)}
        check = sum(weight * value for weight, value in enumerate(values.values(), 1))
        return structure(JOB_KIND, {**values, "CHECK": check})


@final
class Mover:
    """Gives jobs to the controller's program and follows them.

    `adrift`: a motion was started, and its end is not confirmed.
    """

    def __init__(self, device: str, clock: Clock, variables: Variables) -> None:
        self.adrift = False
        self._device = device
        self._clock = clock
        self._variables = variables

    async def run(self, job: Job) -> JointReadings:
        """Do a job; returns the actual joints on arrival, degrees.

        Raises DeviceRefused and LimitExceeded (nothing moved), DeviceFault (the robot stands), DeviceLost. Held in
        every case: in any doubt, and where this is cancelled, the stop flag is set and standstill awaited.
        """
        try:
            number = await self._prepare(job)
            limit_s = await self._longest(job)
            self.adrift = True
            await self._variables.write("KV_GO", str(number))
            await self._follow(number, limit_s)
            self.adrift = False
        except BaseException as error:
            if not await see_through(self.halt()) and isinstance(error, DeviceError):
                raise self._not_confirmed(error) from error
            raise
        return await self._arrived(job)

    async def halt(self) -> bool:
        """Set the stop flag and wait for standstill; returns whether the controller confirmed it."""
        if self.adrift:
            with suppress(DeviceError, TimeoutError):
                async with self._clock.timeout(_HALT_S):
                    await self._variables.write(STOP, "TRUE")
                    while not await self._stands():
                        await self._clock.sleep(POLL_S)
                self.adrift = False
        return not self.adrift

    async def _prepare(self, job: Job) -> int:
        """Check that the controller is ready and idle, clear the stop, set the timer, write the job; its number."""
        variables = self._variables
        await require_ready(self._device, variables, self._clock)
        done, given = await variables.whole("KV_DONE"), await variables.whole("KV_GO")
        if done != given:
            what = f"move: the program is at job {given}, which somebody else gave, and has ended job {done}"
            raise DeviceRefused(self._device, what, "End the other program that uses this proxy, then try again.")
        number = done % _LAST_NUMBER + 1
        await variables.write_verified(STOP, "FALSE")
        await self._still_here()
        await variables.write_verified(SILENCE_STOPPED, "FALSE")
        await variables.write_verified(JOB, job.written(number))
        return number

    async def _longest(self, job: Job) -> float:
        """The time limit of a move, s."""
        here = await self._variables.joints(ACTUAL)
        farthest = max(abs(a - b) for a, b in zip(job.joints, here, strict=True))
        await self._still_here()
        return 2 * farthest / (_SLOW_AXIS_DEG_S * job.percent / 100) + _BESIDES_S

    async def _still_here(self) -> None:
        """Set the timer again: the program stops a move when it runs out."""
        await self._variables.write(SILENCE, str(-SILENCE_MS))

    async def _follow(self, number: int, limit_s: float) -> None:
        """Until the program has ended the job. Raises what it ended with."""
        deadline = self._clock.now() + limit_s
        while await self._variables.whole("KV_DONE") != number:
            await self._still_here()
            if await self._variables.truth("$STOPMESS"):
                raise DeviceFault(self._device, "move: the controller stopped and shows a message", _MESSAGE_CURE)
            if self._clock.now() > deadline:
                raise DeviceLost(self._device, f"the move did not end in {limit_s:.0f} s")
            await self._clock.sleep(POLL_S)
        outcome = await self._variables.whole("KV_OUTCOME")
        if outcome:
            self.adrift = False
            raise self._refusal(outcome)

    async def _arrived(self, job: Job) -> JointReadings:
        """The joints at rest. Raises DeviceFault if they are not the job's: the channel verifies nothing by itself."""
        joints = await self._variables.joints(ACTUAL)
        away = max(abs(a - b) for a, b in zip(joints, job.joints, strict=True))
        if away > _ARRIVED_DEG:
            what = f"move: the program reports its end, and the robot is {away:.2f} deg away from the target"
            raise DeviceFault(self._device, what, "Is the program the one that `cellctl krl` wrote? Who else moves it?")
        return joints

    async def _stands(self) -> bool:
        """Whether the robot stands and no job is waiting or in progress."""
        if not await self._variables.truth("$ROB_STOPPED"):
            return False
        if await self._variables.whole("KV_GO") == await self._variables.whole("KV_DONE"):
            return True
        return await self._variables.text("$PRO_STATE1") != "#P_ACTIVE"

    def _refusal(self, outcome: int) -> DeviceError:
        """The error for an outcome other than 0."""
        match outcome:
            case 12:
                return DeviceRefused(self._device, "move: the program found the controller not ready")
            case 20:
                return LimitExceeded(self._device, "move: the program found the target outside an axis limit")
            case 21:
                return LimitExceeded(self._device, "move: the program refuses the speed")
            case 22:
                cure = "Does another program write to this controller's variables?"
                return DeviceFault(self._device, "move: the job that arrived does not fit its check", cure)
            case 30:
                what = "move: stopped by the stop flag, or because this computer was silent; the robot is held"
                return DeviceFault(self._device, what)
            case 42:
                return DeviceRefused(self._device, "move: the active table has no such row")
        return DeviceFault(self._device, f"move: ended with the unknown outcome {outcome}", _MESSAGE_CURE)

    def _not_confirmed(self, error: DeviceError) -> DeviceUncertain:
        return DeviceUncertain(
            self._device,
            f"{error.what}; the controller has not confirmed that the robot stands",
            f"Its program stops the robot {SILENCE_MS / 1000:g} s after this computer's last word. Keep away from it, "
            "stop it at the pendant, then look at the line.",
        )
