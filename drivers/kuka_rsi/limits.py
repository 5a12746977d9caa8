"""Limits of a search: refused before it starts, and watched in every cycle by the process that sends corrections."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import asdict, dataclass
from enum import IntEnum
from typing import Self, final

AXES = 6
"""Axes in a telegram and in a correction, whatever the robot has."""

Correction = tuple[float, ...]
"""Offset of A1…A6 from the pose at RSI_ON, degrees."""

_SLACK = 1e-6
"""Relative slack for rounding in differences of nearly equal numbers."""


class Limit(IntEnum):
    """Which limit was passed."""

    NONE = 0
    CORRECTION = 1
    TRAVEL = 2
    SPEED = 3
    ACCELERATION = 4
    JERK = 5


@final
@dataclass(frozen=True, slots=True)
class SearchLimits:
    """What a search may ask of the robot.

    `correction_deg`: of each axis, from the pose at RSI_ON; `travel_deg`: of the Euclidean norm of the joint vector;
    `speed_deg_s`, `acceleration_deg_s2`, `jerk_deg_s3`: derivatives of that path length. The stop on contact has a
    deceleration of its own, see `CycleWatch`.
    """

    correction_deg: float = 5.0
    speed_deg_s: float = 2.0
    acceleration_deg_s2: float = 20.0
    jerk_deg_s3: float = 400.0
    travel_deg: float = 5.0

    @classmethod
    def from_settings(cls, settings: dict[str, float]) -> Self:
        """Limits with the missing ones at their low defaults. Raises ValueError for an unknown name or a bad value."""
        known = asdict(cls())
        if unknown := settings.keys() - known.keys():
            raise ValueError(f"unknown robot limit {', '.join(sorted(unknown))} (known: {', '.join(known)})")
        bad = [f"{name}: {value}" for name, value in settings.items() if not (math.isfinite(value) and value > 0)]
        if bad:
            raise ValueError(f"a robot limit must be a positive number ({', '.join(bad)})")
        return cls(**settings)

    def passed_by(self, correction: Correction, speed_deg_s: float) -> list[str]:
        """What a search to `correction` at `speed_deg_s` would pass, in words; empty where it may go."""
        largest, travel = max(map(abs, correction)), math.hypot(*correction)
        asked = {"correction_deg": largest, "travel_deg": travel, "speed_deg_s": speed_deg_s}
        return [
            f"{name} {value:.4g} (at most {getattr(self, name):g})"
            for name, value in asked.items()
            if not value <= getattr(self, name) * (1 + _SLACK)
        ]


@final
class CycleWatch:
    """Looks at each correction about to be sent, against the three sent before it.

    Differences of a set-point sampled every cycle are means of its derivatives, so a path within the limits passes and
    one outside does not. Braking is allowed `speed_deg_s` / (2 × cycle) and any jerk: that is what standing still in
    the second telegram takes (2 deg/s at 4 ms: 250 deg/s²; 5 deg/s: 625 deg/s²).
    """

    def __init__(self, limits: SearchLimits, cycle_s: float) -> None:
        self._limits = limits
        self._cycle_s = cycle_s
        self._sent: deque[Correction] = deque([(0.0,) * AXES] * 3, maxlen=3)

    def look(self, correction: Correction, *, braking: bool = False) -> Limit:
        """The first limit that sending `correction` now would pass; it counts as sent only where that is none."""
        passed = self._place(correction) or self._motion(correction, braking)
        if passed is Limit.NONE:
            self._sent.append(correction)
        return passed

    def stood(self) -> None:
        """The controller held the last correction for a while: whatever moved before, it stands now."""
        self._sent.extend([self._sent[-1]] * 3)

    def _place(self, correction: Correction) -> Limit:
        if not max(map(abs, correction)) <= self._limits.correction_deg * (1 + _SLACK):
            return Limit.CORRECTION
        return Limit.NONE if math.hypot(*correction) <= self._limits.travel_deg * (1 + _SLACK) else Limit.TRAVEL

    def _motion(self, correction: Correction, braking: bool) -> Limit:
        limits, dt = self._limits, self._cycle_s
        a, b, c = self._sent
        steps = [_minus(correction, c), _minus(c, b), _minus(b, a)]
        bends = [_minus(steps[0], steps[1]), _minus(steps[1], steps[2])]
        acceleration = limits.speed_deg_s / (2 * dt) if braking else limits.acceleration_deg_s2
        if not _size(steps[0]) <= limits.speed_deg_s * dt:
            return Limit.SPEED
        if not _size(bends[0]) <= acceleration * dt**2:
            return Limit.ACCELERATION
        if not braking and not _size(_minus(*bends)) <= limits.jerk_deg_s3 * dt**3:
            return Limit.JERK
        return Limit.NONE


def _minus(a: Correction, b: Correction) -> Correction:
    return tuple(x - y for x, y in zip(a, b, strict=True))


def _size(vector: Correction) -> float:
    return math.hypot(*vector) * (1 - _SLACK) - 1e-12
