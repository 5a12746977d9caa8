"""Motions of the axes as closed functions of time, and when a smooth gap opens or closes on the way.

Joints in degrees as the controller counts them, time in nanoseconds of the cell, velocities in deg/s.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import cos, pi, sin, sqrt
from typing import Protocol, final

Joints = tuple[float, ...]

FULL_SPEED_AFTER_S = 0.4
"""Every axis reaches its highest speed in this time: its acceleration is max_speed / 0.4 s."""


class Motion(Protocol):
    """Where the axes are from `start_ns` to `end_ns`, and before and after it at rest."""

    start_ns: int
    end_ns: int

    def at(self, time_ns: int) -> Joints:
        """Joints at a time."""

    def velocity(self, time_ns: int) -> Joints:
        """Their velocities."""

    def share(self, time_ns: int) -> float:
        """How much of the way is done, 0 … 1."""


@final
class Standing:
    """No motion."""

    __slots__ = ("_joints", "end_ns", "start_ns")

    def __init__(self, joints: Joints, time_ns: int) -> None:
        self.start_ns = self.end_ns = time_ns
        self._joints = joints

    def at(self, time_ns: int) -> Joints:
        """The same at any time."""
        return self._joints

    def velocity(self, time_ns: int) -> Joints:
        """Zero."""
        return (0.0,) * len(self._joints)

    def share(self, time_ns: int) -> float:
        """All of it."""
        return 1.0


@final
class PointToPoint:
    """All axes start and arrive together; the leading axis at its speed, speeding up and slowing down as half a cosine.

    With the way s from 0 to 1: ds/dt rises to V over `ramp` seconds as V(1 − cos(πt/ramp))/2, so acceleration is
    continuous, its peak V·π/(2·ramp); V and the peak are the largest that no axis minds.
    """

    __slots__ = ("_from", "_ramp", "_speed", "_way", "end_ns", "start_ns")

    def __init__(
        self, start: Joints, target: Joints, speeds: Sequence[float], accelerations: Sequence[float], time_ns: int
    ) -> None:
        self._from = start
        self._way = tuple(b - a for a, b in zip(start, target, strict=True))
        self.start_ns = self.end_ns = time_ns
        if not any(self._way):
            self._speed = self._ramp = 0.0
            return
        speed = min(v / abs(way) for v, way in zip(speeds, self._way, strict=True) if way)
        acceleration = min(a / abs(way) for a, way in zip(accelerations, self._way, strict=True) if way)
        self._speed = min(speed, sqrt(2.0 * acceleration / pi))  # the second: no cruise, 1 = V·ramp
        self._ramp = pi * self._speed / (2.0 * acceleration)
        self.end_ns = time_ns + round((1.0 / self._speed + self._ramp) * 1e9)

    def share(self, time_ns: int) -> float:
        """The way s, 0 … 1."""
        if time_ns >= self.end_ns:
            return 1.0
        t, left = (time_ns - self.start_ns) * 1e-9, (self.end_ns - time_ns) * 1e-9
        if t < self._ramp:
            return self._ramped(max(t, 0.0))
        return 1.0 - self._ramped(left) if left < self._ramp else self._speed * (t - self._ramp / 2.0)

    def at(self, time_ns: int) -> Joints:
        """Joints on the straight line in joint space."""
        share = self.share(time_ns)
        return tuple(a + share * way for a, way in zip(self._from, self._way, strict=True))

    def velocity(self, time_ns: int) -> Joints:
        """Along the line."""
        if not self.start_ns < time_ns < self.end_ns:
            return (0.0,) * len(self._way)
        edge = min(time_ns - self.start_ns, self.end_ns - time_ns) * 1e-9
        rate = self._speed * (1.0 if edge >= self._ramp else (1.0 - cos(pi * edge / self._ramp)) / 2.0)
        return tuple(rate * way for way in self._way)

    def _ramped(self, t: float) -> float:
        return self._speed * (t - self._ramp / pi * sin(pi * t / self._ramp)) / 2.0


@final
class Braking:
    """From a velocity to standstill, every axis decelerating evenly, all standing at the same moment."""

    __slots__ = ("_from", "_seconds", "_velocity", "end_ns", "start_ns")

    def __init__(self, joints: Joints, velocity: Joints, accelerations: Sequence[float], time_ns: int) -> None:
        self._from = joints
        self._velocity = velocity
        self._seconds = max(abs(v) / a for v, a in zip(velocity, accelerations, strict=True))
        self.start_ns = time_ns
        self.end_ns = time_ns + round(self._seconds * 1e9)

    def at(self, time_ns: int) -> Joints:
        """On the parabola."""
        if not self._seconds:
            return self._from
        t = min((time_ns - self.start_ns) * 1e-9, self._seconds)
        factor = t - t * t / (2.0 * self._seconds)
        return tuple(a + factor * v for a, v in zip(self._from, self._velocity, strict=True))

    def velocity(self, time_ns: int) -> Joints:
        """Falling evenly."""
        factor = 1.0 - self.share(time_ns)
        return tuple(factor * v for v in self._velocity)

    def share(self, time_ns: int) -> float:
        """Share of the braking time that is over."""
        return min((time_ns - self.start_ns) * 1e-9 / self._seconds, 1.0) if self._seconds else 1.0


@final
@dataclass(frozen=True, slots=True)
class State:
    """Joints and their velocities at one moment."""

    joints: Joints
    velocity: Joints


@final
class Cycle:
    """One interpolation cycle between two states, by the cubic that has both places and both velocities."""

    __slots__ = ("_after", "_before", "end_ns", "start_ns")

    def __init__(self, before: State, after: State, start_ns: int, end_ns: int) -> None:
        self._before = before
        self._after = after
        self.start_ns = start_ns
        self.end_ns = end_ns

    def at(self, time_ns: int) -> Joints:
        """The cubic; its ends, which is where it is asked for most, as they were given."""
        if time_ns >= self.end_ns:
            return self._after.joints
        if time_ns <= self.start_ns:
            return self._before.joints
        s, h = self.share(time_ns), (self.end_ns - self.start_ns) * 1e-9
        r = 1.0 - s
        a, b = (1.0 + 2.0 * s) * r * r, s * s * (3.0 - 2.0 * s)
        c, d = s * r * r * h, -s * s * r * h
        before, after = self._before, self._after
        return tuple(
            a * x0 + b * x1 + c * v0 + d * v1
            for x0, x1, v0, v1 in zip(before.joints, after.joints, before.velocity, after.velocity, strict=True)
        )

    def velocity(self, time_ns: int) -> Joints:
        """Its derivative."""
        if time_ns >= self.end_ns:
            return self._after.velocity
        if time_ns <= self.start_ns:
            return self._before.velocity
        s, h = self.share(time_ns), (self.end_ns - self.start_ns) * 1e-9
        a, c, d = 6.0 * s * (1.0 - s) / h, (1.0 - s) * (1.0 - 3.0 * s), s * (3.0 * s - 2.0)
        before, after = self._before, self._after
        return tuple(
            a * (x1 - x0) + c * v0 + d * v1
            for x0, x1, v0, v1 in zip(before.joints, after.joints, before.velocity, after.velocity, strict=True)
        )

    def share(self, time_ns: int) -> float:
        """Share of the cycle that is over."""
        return min((time_ns - self.start_ns) / (self.end_ns - self.start_ns), 1.0)


Gap = Callable[[int], float]
"""Gap in mm at a time in nanoseconds; closed where it is not above zero."""

_GOLDEN = 0.3819660112501051
_NEAREST_NS = 1000


def crossings(gap: Gap, times: Sequence[int]) -> list[tuple[int, bool]]:
    """Each change inside `times` (ascending, at least two samples) as (first nanosecond after it, closed).

    `gap` is looked at at the sample times; between two of opposite sign the root is bisected to the nanosecond, and
    where three lie on one side with the middle one nearest to zero, the extremum between is looked for.
    """
    gaps = [gap(time) for time in times]
    knots = list(zip(times, gaps, strict=True))
    for i in range(len(times) - 2, 0, -1):
        if _bends_towards_zero(gaps[i - 1 : i + 2]):
            knots.insert(i + 1, _extremum(gap, times[i - 1], times[i + 1], knots[i]))
    knots.sort()
    return [
        (_root(gap, a, b, g_b <= 0), g_b <= 0) for (a, g_a), (b, g_b) in pairwise(knots) if (g_a <= 0) != (g_b <= 0)
    ]


def _bends_towards_zero(gaps: Sequence[float]) -> bool:
    before, middle, after = gaps
    if min(gaps) > 0:
        return middle <= before and middle <= after
    return max(gaps) <= 0 and middle >= before and middle >= after


def _extremum(gap: Gap, start: int, end: int, middle: tuple[int, float]) -> tuple[int, float]:
    """Golden section between `start` and `end`: the knot where the gap is nearest to the other sign."""
    side = 1.0 if middle[1] > 0 else -1.0
    best = middle
    while end - start > _NEAREST_NS:
        low = start + int(_GOLDEN * (end - start))
        high = end - (low - start)
        g_low, g_high = gap(low), gap(high)
        best = min(best, (low, g_low), (high, g_high), key=lambda knot: side * knot[1])
        if side * best[1] <= 0:
            break
        start, end = (start, high) if side * g_low < side * g_high else (low, end)
    return best


def _root(gap: Gap, before: int, after: int, closed_after: bool) -> int:
    while after - before > 1:
        middle = (before + after) // 2
        if (gap(middle) <= 0) == closed_after:
            after = middle
        else:
            before = middle
    return after
