"""The controller's drives: how an axis follows its set-point, leaps that stop the robot, the shown currents."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from math import exp
from operator import gt
from typing import final

from sims.scene.motions import FULL_SPEED_AFTER_S, Joints, State

TIME_CONSTANT_S = 0.012
LAG_MS = 2e3 * TIME_CONSTANT_S


@final
class Servo:
    """The position loops of all axes, advanced one interpolation cycle at a time.

    ẍ = ω²(u − x) − 2ωẋ with ω = 1/12 ms, the set-point u going evenly from the last cycle's to this one's (the
    controller's fine interpolation), so that at a constant speed the axis is `LAG_MS` = 24 ms behind. Change of
    velocity in a cycle is bounded by max_speed / 0.4 s, velocity by max_speed. `scale` shortens (or lengthens) lag and
    widens the bounds; with 0 the axis is at its set-point.
    """

    def __init__(self, max_speeds: Sequence[float], cycle_s: float, scale: float) -> None:
        self._cycle_s = cycle_s
        self._rigid = scale <= 0.0
        self._speeds = tuple(max_speeds)
        if not self._rigid:
            self._omega = 1.0 / (TIME_CONSTANT_S * scale)
            self._decay = exp(-self._omega * cycle_s)
            self._steps = tuple(speed / FULL_SPEED_AFTER_S * cycle_s / scale for speed in max_speeds)

    def follow(self, state: State, before: Joints, after: Joints) -> State:
        """The state one cycle on, the set-point having gone from `before` to `after`."""
        if self._rigid:
            h = self._cycle_s
            return State(after, tuple((b - a) / h for a, b in zip(before, after, strict=True)))
        axes = zip(state.joints, state.velocity, before, after, self._steps, self._speeds, strict=True)
        joints, velocity = zip(*[self._axis(*axis) for axis in axes], strict=True)
        return State(joints, velocity)

    def _axis(
        self, x: float, v: float, before: float, after: float, step: float, max_speed: float
    ) -> tuple[float, float]:
        h, omega = self._cycle_s, self._omega
        rate = (after - before) / h
        lag = 2.0 * rate / omega
        y = x - before + lag  # beside the steady lag, whose decay is (y + B t) e^{−ωt}
        b = v - rate + omega * y
        now = (y + b * h) * self._decay
        v_next = rate + b * self._decay - omega * now
        if abs(v_next - v) <= step and abs(v_next) <= max_speed:
            return after - lag + now, v_next
        v_next = max(v - step, min(v + step, v_next))
        v_next = max(-max_speed, min(max_speed, v_next))
        return x + (v + v_next) / 2.0 * h, v_next


VELOCITY_SHARE = 1.1
"""Of an axis' highest speed (machine datum $VEL_ACT_MA, %; 110 is its usual value [unconfirmed])."""

ACCELERATION_SHARE = 7.0
"""Of highest speed / acceleration time (machine datum $ACC_ACT_MA, %; its usual value is not published).

A set-point of 5 deg/s that catches up one lost answer (2500 deg/s² at 4 ms) is 6.5 of A1's, the slowest axis of the
KR5; a step of 0.25° in a cycle of 4 ms (15 600 deg/s²) is 8.7 of A6's, the fastest.
"""


VELOCITY = "KSS01102 Command velocity"
ACCELERATION = "Command acceleration"
"""Messages; the axis follows. The number of the second one [unconfirmed] is left out."""


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
        if any(map(gt, speeds, self._speeds)):
            return f"{VELOCITY} A{_first_above(speeds, self._speeds)}"
        if any(map(gt, accelerations, self._accelerations)):
            return f"{ACCELERATION} A{_first_above(accelerations, self._accelerations)}"
        return ""


def _first_above(values: Sequence[float], limits: Sequence[float]) -> int:
    """The number of the first axis above its limit, from 1."""
    return next(i for i, (value, limit) in enumerate(zip(values, limits, strict=True), 1) if value > limit)


NOISE_A = 0.02
"""1 σ of one telegram's value."""
STEP_A = 0.001


@final
class CurrentDisplay:
    """Amperes of A1…An with noise and resolution; `true`: the mean currents now."""

    def __init__(self, true: Callable[[], tuple[float, ...]], seed: int) -> None:
        self._true = true
        self._random = random.Random(f"{seed} motor currents of the controller")

    def now(self) -> list[float]:
        """Of the present telegram; every call draws anew."""
        return [round((value + self._random.gauss(0.0, NOISE_A)) / STEP_A) * STEP_A for value in self._true()]
