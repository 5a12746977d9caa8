"""What the drives put between a joint's reading and where its link is: the gear's waves, and its play.

Readings in degrees as the controller counts them.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import pi, radians, sin
from typing import final

from sims.world.errors import generator

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
