"""What the controller reports by RTDE: one sample of it, and its modes by name.

Source: Universal Robots, RTDE Guide (robot_mode, safety_status, robot_status_bits); safety_status has been there since
PolyScope 3.10 and 5.4.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self, final

from cellctl.devices import JointReadings
from drivers.ur_rtde.codec import Value

ROBOT_MODES = {
    -1: "no controller",
    0: "disconnected",
    1: "confirm safety",
    2: "booting",
    3: "power off",
    4: "power on",
    5: "idle (brakes closed)",
    6: "backdrive",
    7: "running",
    8: "updating firmware",
}
RUNNING = 7

SAFETY_STATES = {
    1: "normal",
    2: "reduced",
    3: "protective stop",
    4: "recovery",
    5: "safeguard stop",
    6: "emergency stop (system)",
    7: "emergency stop (robot)",
    8: "violation",
    9: "fault",
    10: "safety parameters to be validated",
    11: "undefined",
    12: "safeguard stop (automatic mode)",
    13: "three-position switch",
}
MOVING_ALLOWED = (1, 2)

_PROGRAM_RUNS = 1 << 1
_TEACH_PRESSED = 1 << 2

OUTPUTS = (
    "timestamp",
    "actual_q",
    "actual_qd",
    "actual_current",
    "robot_mode",
    "safety_status",
    "robot_status_bits",
    "actual_digital_input_bits",
    "output_int_register_24",
    "output_int_register_25",
    "output_int_register_26",
    "output_int_register_27",
    "output_int_register_28",
    "output_int_register_29",
)

STANDS_RAD_S = math.radians(0.02)
"""A joint slower than this stands: ten times the speed that the encoders' noise shows at rest."""


@final
@dataclass(frozen=True, slots=True)
class Sample:
    """One data package. `time_s`: the controller's clock; `arrival_ns`: the cell's; joints in deg, currents in A."""

    time_s: float
    arrival_ns: int
    joints: JointReadings
    speeds_rad_s: tuple[float, ...]
    currents: tuple[float, ...]
    robot_mode: int
    safety_status: int
    status_bits: int
    inputs: int
    digest: tuple[int, int]
    taken: int
    ended: int
    outcome: int
    heard: int

    @classmethod
    def of(cls, values: Mapping[str, Value], arrival_ns: int) -> Self:
        """From a data package. Raises ValueError if a number in it is not finite."""
        time_s, joints, speeds = _number(values["timestamp"]), _six(values["actual_q"]), _six(values["actual_qd"])
        currents = _six(values["actual_current"])
        if not all(map(math.isfinite, (time_s, *joints, *speeds, *currents))):
            raise ValueError("a data package has a number that is not finite")
        whole = {name: int(_number(values[name])) for name in OUTPUTS[4:]}
        return cls(
            time_s=time_s,
            arrival_ns=arrival_ns,
            joints=tuple(map(math.degrees, joints)),
            speeds_rad_s=speeds,
            currents=currents,
            robot_mode=whole["robot_mode"],
            safety_status=whole["safety_status"],
            status_bits=whole["robot_status_bits"],
            inputs=whole["actual_digital_input_bits"],
            digest=(whole["output_int_register_24"], whole["output_int_register_25"]),
            taken=whole["output_int_register_26"],
            ended=whole["output_int_register_27"],
            outcome=whole["output_int_register_28"],
            heard=whole["output_int_register_29"],
        )

    @property
    def stands(self) -> bool:
        """Whether every joint stands."""
        return max(map(abs, self.speeds_rad_s)) < STANDS_RAD_S

    @property
    def program_runs(self) -> bool:
        """Whether a program runs on the controller; which one, the digest says."""
        return bool(self.status_bits & _PROGRAM_RUNS)

    def obstacles(self) -> list[str]:
        """Each reason against a motion that the modes state; empty if there is none."""
        found = []
        if self.safety_status not in MOVING_ALLOWED:
            found.append(SAFETY_STATES.get(self.safety_status, f"safety status {self.safety_status}"))
        if self.robot_mode != RUNNING:
            found.append(ROBOT_MODES.get(self.robot_mode, f"robot mode {self.robot_mode}"))
        if self.status_bits & _TEACH_PRESSED:
            found.append("freedrive: the teach button is pressed")
        return found


def _number(value: Value) -> float:
    if isinstance(value, tuple):
        raise ValueError("a vector stands where RTDE has a number")
    return float(value)


def _six(value: Value) -> tuple[float, ...]:
    if not isinstance(value, tuple) or len(value) != 6:
        raise ValueError("a joint vector has not six numbers")
    return tuple(map(float, value))
