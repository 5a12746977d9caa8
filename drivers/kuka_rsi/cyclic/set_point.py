"""The set-point along a joint-space line: a jerk-limited motion, and a stop within two telegrams."""

from __future__ import annotations

import math
from typing import final

from ruckig import InputParameter, Result, Ruckig, Trajectory

from drivers.kuka_rsi.cyclic.limits import Correction, SearchLimits


@final
class SetPoint:
    """A point on the line from the pose at RSI_ON (0) to `correction`, one step a cycle; every axis in proportion.

    `correction`: offset of A1…A6 at the line's end, degrees; `speed_deg_s`: of the Euclidean norm.
    """

    def __init__(self, correction: Correction, speed_deg_s: float, limits: SearchLimits, cycle_s: float) -> None:
        self._end = correction
        self._length = math.hypot(*correction)
        self._speed = speed_deg_s
        self._limits = limits
        self._cycle_s = cycle_s
        self._here = self._before = 0.0
        self._otg = Ruckig(1)
        self.stand_and_go()

    @property
    def correction(self) -> Correction:
        """Offset of A1…A6 from the pose at RSI_ON, degrees."""
        share = self._here / self._length if self._length else 0.0
        return tuple(share * axis for axis in self._end)

    @property
    def place_deg(self) -> float:
        """Distance travelled on the line, degrees."""
        return self._here

    @property
    def arrived(self) -> bool:
        """Whether the end of the line is reached."""
        return bool(self._elapsed >= self._profile.duration)

    def stand_and_go(self) -> None:
        """Plan from standstill here: at the start, and after the controller held the last correction for a while."""
        plan = InputParameter(1)
        plan.current_position, plan.target_position = [self._here], [self._length]
        plan.max_velocity = [self._speed]
        plan.max_acceleration = [self._limits.acceleration_deg_s2]
        plan.max_jerk = [self._limits.jerk_deg_s3]
        self._profile = Trajectory(1)
        result = self._otg.calculate(plan, self._profile)
        if result not in (Result.Working, Result.Finished):
            raise ValueError(f"no profile of {self._length} deg at {self._speed} deg/s: {result}")
        self._elapsed = 0.0
        self._before = self._here

    def advance(self) -> None:
        """One cycle further along the profile."""
        self._elapsed += self._cycle_s
        self._move_to(self._profile.at_time(min(self._elapsed, self._profile.duration))[0][0])

    def brake(self) -> None:
        """Half of the last step, from constant deceleration to a stop within one cycle; then `hold`."""
        self._move_to(min(self._here + (self._here - self._before) / 2, self._length))

    def hold(self) -> None:
        """Stay."""
        self._before = self._here

    def _move_to(self, place: float) -> None:
        self._before, self._here = self._here, place
