"""Limits of a move: the cell file's for speed, the controller's own software limits for the axes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self, final

from cellctl.devices import Finding, JointReadings, LimitExceeded
from drivers.kuka_varproxy.literals import AXES
from drivers.kuka_varproxy.variables import Variables

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
