"""How an axis follows its set-point: critically damped, and no faster than its drive can accelerate."""

from __future__ import annotations

from collections.abc import Sequence
from math import exp
from typing import final

from sims.scene.motions import FULL_SPEED_AFTER_S, Joints, State

TIME_CONSTANT_S = 0.012


@final
class Servo:
    """The position loops of all axes, advanced one interpolation cycle at a time.

    ẍ = ω²(u − x) − 2ωẋ with ω = 1/12 ms, the set-point u going evenly from the last cycle's to this one's (the
    controller's fine interpolation), so that at a constant speed the axis is 24 ms behind. Change of velocity in a
    cycle is bounded by max_speed / 0.4 s, velocity by max_speed. `scale` 0 … 1 shortens lag and widens the bounds; with
    0 the axis is at its set-point.
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
