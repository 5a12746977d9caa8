"""How a way is gone in time: with even acceleration, behind a target, towards a speed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, sqrt
from typing import final


@final
@dataclass(frozen=True, slots=True)
class Trapezoid:
    """A way from 0 to 1 with even acceleration. `speed`, `acceleration`: shares of the way a second, a second²."""

    speed: float
    acceleration: float

    @classmethod
    def of(cls, way: float, speed: float, acceleration: float, seconds: float) -> Trapezoid:
        """`seconds`: how long it takes, in place of speed and acceleration, a quarter of it each to speed up and brake;
        0: as they are.
        """
        if seconds > 0.0:
            return cls(4.0 / (3.0 * seconds), 16.0 / (3.0 * seconds * seconds))
        v, a = max(speed, 1e-6) / way, max(acceleration, 1e-6) / way
        return cls(min(v, sqrt(a)), a)

    @property
    def seconds(self) -> float:
        """How long it takes."""
        return 1.0 / self.speed + self.speed / self.acceleration

    def at(self, t: float) -> float:
        """The share of the way that is done."""
        ramp = self.speed / self.acceleration
        if t >= self.seconds:
            return 1.0
        if t < ramp:
            return self.acceleration * t * t / 2.0
        left = self.seconds - t
        return 1.0 - self.acceleration * left * left / 2.0 if left < ramp else self.speed * (t - ramp / 2.0)


def followed(x: float, v: float, before: float, after: float, omega: float, h: float) -> tuple[float, float]:
    """Place and speed after a cycle h of ẍ = ω²(u − x) − 2ωẋ, u going evenly from `before` to `after`.

    Beside its steady lag 2u̇/ω, whose difference y decays as (y + (ẏ + ωy) t) e^{−ωt}.
    """
    rate = (after - before) / h
    lag = 2.0 * rate / omega
    y = x - before + lag
    b = v - rate + omega * y
    decay = exp(-omega * h)
    now = (y + b * h) * decay
    return after - lag + now, rate + b * decay - omega * now


def towards(speeds: Sequence[float], wanted: Sequence[float], step: float) -> tuple[float, ...]:
    """From one velocity towards another, the part that changes most by `step`."""
    changes = [w - s for w, s in zip(wanted, speeds, strict=True)]
    most = max(map(abs, changes))
    if most <= step:
        return tuple(float(part) for part in wanted)
    return tuple(s + change * step / most for s, change in zip(speeds, changes, strict=True))
