"""The drives' monitoring of the commanded motion: a set-point that leaps stops the robot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

from sims.scene.motions import FULL_SPEED_AFTER_S, Joints

VELOCITY_SHARE = 1.1
"""Of an axis' highest speed (machine datum $VEL_ACT_MA, %; 110 is its usual value [unconfirmed])."""

ACCELERATION_SHARE = 7.0
"""Of highest speed / acceleration time (machine datum $ACC_ACT_MA, %; its usual value is not published).

A set-point of 5 deg/s that catches up one lost answer (2500 deg/s² at 4 ms) is 6.5 of A1's, the slowest axis of the
KR5; a step of 0.25° in a cycle of 4 ms (15 600 deg/s²) is 8.7 of A6's, the fastest.
"""


@final
class DriveMonitor:
    """Differences of the set-point from cycle to cycle against the axes' limits. `max_speeds` in deg/s.

    Source of the two rules: KUKA KR C2 Operating Handbook, Machine Data, 2.1.115 and 2.1.116.
    """

    def __init__(self, max_speeds: Sequence[float], cycle_s: float) -> None:
        self._cycle_s = cycle_s
        self._speeds = [VELOCITY_SHARE * speed for speed in max_speeds]
        self._accelerations = [ACCELERATION_SHARE * speed / FULL_SPEED_AFTER_S for speed in max_speeds]

    def message(self, earlier: Joints, before: Joints, now: Joints) -> str:
        """What the controller shows for three set-points in a row; empty where every axis can follow."""
        h = self._cycle_s
        speeds = [abs(c - b) / h for b, c in zip(before, now, strict=True)]
        accelerations = [abs(c - 2.0 * b + a) / h**2 for a, b, c in zip(earlier, before, now, strict=True)]
        if axis := _first_above(speeds, self._speeds):
            return f"KSS01102 Command velocity A{axis}"
        if axis := _first_above(accelerations, self._accelerations):
            return f"Command acceleration A{axis}"  # its number [unconfirmed] is left out
        return ""


def _first_above(values: Sequence[float], limits: Sequence[float]) -> int:
    """The number of the first axis above its limit, from 1; 0 where there is none."""
    return next((i for i, (value, limit) in enumerate(zip(values, limits, strict=True), 1) if value > limit), 0)
