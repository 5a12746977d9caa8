"""The instrument's noise, drawn by what is measured and not by time, so that a resumed campaign sees the same.

A draw belongs to (seed, reflector, commanded joints and attempt of the robot, number of the reading there).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, final

from sims.geocom.profiles import COMMON, SAMPLE, Profile
from sims.world.errors import generator


@final
@dataclass(frozen=True, slots=True)
class SetUp:
    """What all measurements of this instrument share: zero (mm) and scale (ppm) of its distances."""

    zero_mm: float = 0.0
    scale_ppm: float = 0.0

    def shift_mm(self, distance_mm: float) -> float:
        """Error of a distance."""
        return self.zero_mm + self.scale_ppm * 1e-6 * distance_mm


def set_up_of(seed: int, profile: Profile, scale: float) -> SetUp:
    """Of this seed's instrument."""
    zero, ppm = scale * COMMON * generator(seed, "tracker set-up").normal(size=2)
    return SetUp(float(zero) * profile.range_mm, float(ppm) * profile.range_ppm)


@final
class Noise:
    """Errors of readings, 1 σ by the profile times `scale`. Call `at` with what is measured, then draw.

    Across the beam 0.6 of the profile's figure is common to all readings of a reflector at one pose of the robot
    (refraction, pointing), 0.8 is drawn for each reading. Along the beam the common part is the set-up's.
    """

    def __init__(self, seed: int, profile: Profile, scale: float) -> None:
        self._seed = seed
        self._profile = profile
        self._scale = scale
        self._pose = ""
        self._counts: Counter[str] = Counter()

    def at(self, pose: str) -> None:
        """The robot's commanded joints and attempt; at a new one the readings are counted anew."""
        if pose != self._pose:
            self._pose = pose
            self._counts.clear()

    def angles(self, target: str, distance_mm: float) -> tuple[float, float]:
        """Of one reading of the circles on a reflector, across horizontally and vertically, rad."""
        common = generator(self._seed, f"tracker aim {target} {self._pose}").normal(size=2)
        sample = self._next(target)
        sigma = self._scale * self._profile.angle_rad(distance_mm)
        across, up = (sigma * (COMMON * float(a) + SAMPLE * float(b)) for a, b in zip(common, sample, strict=False))
        return across, up

    def distance(self, target: str, distance_mm: float) -> float:
        """Of one measured distance, mm, without the set-up's part."""
        sigma = self._profile.range_mm + self._profile.range_ppm * 1e-6 * distance_mm
        return self._scale * SAMPLE * sigma * self._next(target)[2]

    def state(self) -> Mapping[str, Any]:
        """To be remembered."""
        return {"pose": self._pose, "readings": dict(self._counts)}

    def recall(self, kept: Any) -> None:
        """Go on from a state. Raises TypeError, LookupError, ValueError."""
        self._pose = str(kept["pose"])
        self._counts = Counter({str(target): int(count) for target, count in kept["readings"].items()})

    def _next(self, target: str) -> list[float]:
        self._counts[target] += 1
        key = f"tracker reading {target} {self._pose} {self._counts[target]}"
        return [float(part) for part in generator(self._seed, key).normal(size=3)]
