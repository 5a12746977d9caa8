"""The drives of the arm: the gears' waves and play between a joint's reading and its link, and the motors' currents.

Readings in degrees as the controller counts them.

No maker publishes these figures. A motor is chosen by the greatest moment about its axis (`sims.world._gravity`), which
it holds at 60 % of its rated current; friction is of the order measured on arms of this class.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import degrees, pi, radians, sin
from typing import final

from sims.world._gravity import Body, Mass, levers, torques, turns
from sims.world.errors import generator
from sims.world.kinematics import Axis, Vector

GEAR_DEG = (0.005, 0.01)
"""Amplitude of the once-per-turn transmission error, from … to; the twice-per-turn one is half as large.

Makers of strain wave and cycloidal gears state one minute of arc from peak to peak: 0.008°. The measured rows of a UR10
give 0.002 to 0.017° (docs/reference/effects.md).
"""
PLAY_DEG = (0.003, 0.01)
"""The whole play of a joint, from … to: up to two thirds of the minute of arc that makers state as most."""


@final
class Gear:
    """Transmission errors of each joint, once and twice per turn of the joint, each with an amplitude and phase of its
    own."""

    def __init__(self, joints: int, seed: int, scale: float) -> None:
        random = generator(seed, "gear")
        once = scale * random.uniform(*GEAR_DEG, joints)
        twice = scale / 2.0 * random.uniform(*GEAR_DEG, joints)
        phases = random.uniform(-pi, pi, (2, joints))
        self.waves: list[tuple[float, float, float, float]] = [
            (float(a), float(p), float(b), float(q))
            for a, p, b, q in zip(once, phases[0], twice, phases[1], strict=True)
        ]
        """Amplitude (deg) and phase (rad) of the first wave, then of the second, for each joint."""

    def turned(self, readings: Sequence[float]) -> list[float]:
        """Where the links are when the joints read this."""
        return [
            reading + a * sin(radians(reading) + p) + b * sin(radians(2.0 * reading) + q)
            for reading, (a, p, b, q) in zip(readings, self.waves, strict=True)
        ]


@final
class Backlash:
    """Play of each joint: the link stays behind the drive by half of it, whichever way that moved last.

    A link's `slack` is how far it is ahead of the reading, within ± `half_deg`: it stays where it is while the drive
    turns back through its play, and is then taken along.
    """

    def __init__(self, joints: int, seed: int, scale: float) -> None:
        plays = scale * generator(seed, "backlash").uniform(*PLAY_DEG, joints)
        self.half_deg = tuple(float(play) / 2.0 for play in plays)

    def behind(self, directions: Sequence[int]) -> tuple[float, ...]:
        """The slack after long ways in these directions (1, −1; 0: the middle); none given: all in the middle."""
        if not directions:
            return (0.0,) * len(self.half_deg)
        return tuple(-direction * half for direction, half in zip(directions, self.half_deg, strict=True))

    def after(self, slack: Sequence[float], start: Sequence[float], end: Sequence[float]) -> tuple[float, ...]:
        """The slack after going straight from the readings `start`, where it was `slack`, to `end`."""
        return tuple(
            max(-half, min(half, ahead - (b - a)))
            for ahead, a, b, half in zip(slack, start, end, self.half_deg, strict=True)
        )


HOLDING_A = (2.5, 4.5)
"""Current for the greatest moment, from … to."""
HOLDING_SHARE = 0.6
"""Of the rated current."""
COULOMB_A = (0.25, 0.45)
VISCOUS_A_S_DEG = (0.003, 0.006)
PRESLIDING_DEG = 0.005
"""Way in which friction grows from nothing to its Coulomb value after an axis has turned back."""

_NM_PER_NMM = 1e-3


@final
class Motors:
    """One motor with its reducer per axis, drawn from `seed`.

    `signs`: of the controller's sense of rotation; `nm_per_a`: joint torque per ampere through the reducer; `rated_a`:
    rated currents. Currents are in the controller's sense.
    """

    def __init__(self, body: Body, axes: Sequence[Axis], signs: Sequence[float], down: Vector, seed: int) -> None:
        random = generator(seed, "motors")
        joints = len(body.links)
        holding = random.uniform(*HOLDING_A, joints).tolist()
        self._body, self._axes, self._signs, self._down = body, tuple(axes), tuple(signs), down
        self._coulomb_a = tuple(random.uniform(*COULOMB_A, joints).tolist())
        self._viscous = tuple(random.uniform(*VISCOUS_A_S_DEG, joints).tolist())
        self.nm_per_a = tuple(moment * _NM_PER_NMM / amps for moment, amps in zip(body.moments, holding, strict=True))
        self.rated_a = tuple(round(amps / HOLDING_SHARE, 1) for amps in holding)

    def holding(self, angles: Sequence[float], payload: Mass | None = None) -> tuple[float, ...]:
        """Amperes that hold links, tool and payload at model angles (rad). `payload`: at model zero, base frame."""
        links = self._body.links
        if payload:
            links = (*links[:-1], links[-1].together(payload))
        turned = turns(angles)
        pulls = torques(self._axes, levers(self._axes, links, turned), turned, self._down)
        return tuple(
            -sign * pull * _NM_PER_NMM / constant
            for sign, pull, constant in zip(self._signs, pulls, self.nm_per_a, strict=True)
        )

    def wound_up(self, rates: Sequence[float]) -> tuple[float, ...]:
        """Degrees that each drive turns by under its whole Coulomb friction; `rates`: rad per N·mm."""
        return tuple(
            degrees(rate * coulomb * constant / _NM_PER_NMM)
            for rate, coulomb, constant in zip(rates, self._coulomb_a, self.nm_per_a, strict=True)
        )

    def friction(self, sliding: Sequence[float], velocity: Sequence[float]) -> tuple[float, ...]:
        """Amperes against friction: Coulomb by `sliding`, viscous by the velocity, deg/s."""
        return tuple(
            coulomb * slid + viscous * speed
            for coulomb, slid, viscous, speed in zip(self._coulomb_a, sliding, self._viscous, velocity, strict=True)
        )


def slid(sliding: Sequence[float], start: Sequence[float], end: Sequence[float]) -> tuple[float, ...]:
    """The share of its Coulomb friction that each axis feels after a straight way from `start` to `end`, deg.

    1 or −1 by the direction of the last motion, less within `PRESLIDING_DEG` after a turn. It stays at rest.
    """
    shares = [before + (b - a) / PRESLIDING_DEG for before, a, b in zip(sliding, start, end, strict=True)]
    return tuple([1.0 if share > 1.0 else -1.0 if share < -1.0 else share for share in shares])


def lagging(readings: Sequence[float], wound_up: Sequence[float], sliding: Sequence[float]) -> tuple[float, ...]:
    """Where the links are, deg, behind drives that carry this share of their Coulomb friction."""
    return tuple(reading - most * share for reading, most, share in zip(readings, wound_up, sliding, strict=True))
