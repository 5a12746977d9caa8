"""What the controller reports of itself, and whether that allows a move."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self, final

from cellctl.clock import Clock
from cellctl.devices import DeviceRefused
from drivers.kuka_varproxy.names import PROGRAM, VERSION
from drivers.kuka_varproxy.variables import Variables

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
