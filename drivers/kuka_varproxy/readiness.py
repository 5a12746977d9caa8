"""What the controller reports of itself, and whether that and the limits of cell and axes allow a move."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self, final

from cellctl.clock import Clock
from cellctl.devices import DeviceRefused, Finding, Health, JointReadings, LimitExceeded
from drivers.kuka_varproxy.line import ProxyLine
from drivers.kuka_varproxy.variables import AXES, PROGRAM, VERSION, Variables

_CEILINGS = {"speed_percent": 100.0}
SLOWEST_PERCENT = 1.0
"""The controller's program takes whole percent."""


@final
@dataclass(frozen=True, slots=True)
class MoveLimits:
    """`speed_percent`: highest speed of a move, percent of each axis' maximum."""

    speed_percent: float = 30.0

    @classmethod
    def of(cls, stated: Mapping[str, float]) -> Self:
        """The limits in the cell file; a missing one takes its default, which is low. Raises ValueError."""
        if found := findings(stated):
            raise ValueError("; ".join(finding.what for finding in found))
        return cls(**stated)


def findings(stated: Mapping[str, float]) -> list[Finding]:
    """Errors in the limits of the cell file."""
    found = []
    for name, value in stated.items():
        highest = _CEILINGS.get(name)
        if highest is None:
            found.append(Finding(f"unknown limit '{name}'", f"there is {', '.join(_CEILINGS)}", name))
        elif not SLOWEST_PERCENT <= value <= highest:
            what = f"limit {name} {value:g} is outside {SLOWEST_PERCENT:g} … {highest:g}"
            found.append(Finding(what, "give a number within these", name))
    return found


@final
@dataclass(frozen=True, slots=True)
class AxisRanges:
    """The software limits of the axes as the controller has them, degrees."""

    ranges: tuple[tuple[float, float], ...]

    @classmethod
    async def read(cls, variables: Variables) -> Self:
        """From `$SOFTN_END` and `$SOFTP_END`. Raises as `Variables` does."""
        numbers = range(1, AXES + 1)
        low = [await variables.number(f"$SOFTN_END[{axis}]") for axis in numbers]
        high = [await variables.number(f"$SOFTP_END[{axis}]") for axis in numbers]
        return cls(tuple(zip(low, high, strict=True)))

    def check(self, device: str, joints: JointReadings) -> None:
        """Raises LimitExceeded if these are no joints, or one is outside its range."""
        if len(joints) != AXES or not all(map(math.isfinite, joints)):
            raise LimitExceeded(device, f"{joints} are not {AXES} joint readings")
        for axis, (angle, (low, high)) in enumerate(zip(joints, self.ranges, strict=True), 1):
            if not low <= angle <= high:
                raise LimitExceeded(device, f"A{axis} {angle:.4f} deg is outside {low:g} … {high:g} deg")


_BEAT_S = 0.1
"""The program counts every 12 ms while it waits for a job."""

_CURE = "Acknowledge the message, switch the drives on, choose EXT, select and start the generated program."


@final
@dataclass(frozen=True, slots=True)
class ControllerState:
    """Operating mode, state and name of the robot program, drives on, a message stands, moves in T1 allowed."""

    mode: str
    program_state: str
    program: str
    drives_on: bool
    message: bool
    t1_allowed: bool

    @classmethod
    async def read(cls, variables: Variables) -> Self:
        """As of now. Raises as `Variables` does."""
        return cls(
            mode=await variables.text("$MODE_OP"),
            program_state=await variables.text("$PRO_STATE1"),
            program=await variables.text("$PRO_NAME1[]"),
            drives_on=await variables.truth("$PERI_RDY"),
            message=await variables.truth("$STOPMESS"),
            t1_allowed=await variables.truth("KV_ALLOW_T1"),
        )

    def obstacles(self) -> list[str]:
        """Each reason against a move; empty if there is none."""
        found = []
        if self.message:
            found.append("a message stands at the pendant")
        if not self.drives_on:
            found.append("the drives are off")
        if self.mode != "#EX" and not (self.mode == "#T1" and self.t1_allowed):
            found.append(f"the mode is {self.mode.lstrip('#')}, not EXT")
        if PROGRAM not in self.program.upper():
            found.append(f"the program selected is '{self.program}', not {PROGRAM}")
        if self.program_state != "#P_ACTIVE":
            found.append(f"the program does not run ({self.program_state})")
        return found


async def require_version(device: str, variables: Variables) -> None:
    """Raises DeviceRefused if the generated program is not on the controller, or another version of it is."""
    found = await variables.whole("KV_VERSION")
    if found != VERSION:
        what = f"the controller's {PROGRAM} has version {found}, this driver needs {VERSION}"
        raise DeviceRefused(device, what, "Load the files that `cellctl krl` writes for this cell.")


async def require_ready(device: str, variables: Variables, clock: Clock) -> None:
    """Raises DeviceRefused unless the controller reports all that a move needs, and our program counts."""
    if found := (await ControllerState.read(variables)).obstacles():
        raise DeviceRefused(device, f"move: {'; '.join(found)}", _CURE)
    before = await variables.whole("KV_BEAT")
    await clock.sleep(_BEAT_S)
    if await variables.whole("KV_BEAT") == before:
        raise DeviceRefused(device, f"move: {PROGRAM} does not count: it waits, or does something else", _CURE)


async def health_of(device: str, variables: Variables, line: ProxyLine) -> Health:
    """In order if the controller reports all that a move needs. Raises DeviceFault, DeviceLost."""
    try:
        await require_version(device, variables)
        state = await ControllerState.read(variables)
    except DeviceRefused as refused:
        return Health(False, f"{refused.what}: the generated program is not there, or not the one of this driver")
    found = state.obstacles()
    figures = {"latency_ms": line.latency_s * 1e3}
    return Health(not found, "; ".join(found) or "EXT, program runs, drives on", figures)
