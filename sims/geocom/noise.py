"""The instrument's noise, drawn by what is measured and not by time, so that a resumed campaign sees the same.

A draw belongs to (seed, reflector, commanded joints and attempt of the robot, number of the reading there).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, final

from sims.geocom.profiles import Profile
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
    zero, ppm = scale * generator(seed, "tracker set-up").normal(size=2)
    return SetUp(float(zero) * profile.common.range_mm, float(ppm) * profile.common.range_ppm)


@final
class Noise:
    """Errors of readings, 1 σ by the profile times `scale`. Call `at` with what is measured, then draw.

    Across the beam a part is common to all readings of a reflector at one pose of the robot (refraction, pointing).
    Along it the common part is the set-up's.
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
        shared, own = (part.angle_rad(distance_mm) for part in (self._profile.common, self._profile.sample))
        across, up = (
            self._scale * (shared * float(one) + own * other) for one, other in zip(common, sample[:2], strict=True)
        )
        return across, up

    def distance(self, target: str, distance_mm: float) -> float:
        """Of one measured distance, mm, without the set-up's part."""
        return self._scale * self._profile.sample.along_mm(distance_mm) * self._next(target)[2]

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
