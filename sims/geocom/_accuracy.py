"""How accurate the instrument is, by its profile, and the noise drawn from it by what is measured and not by time.

The figures are 1 σ. A maximum permissible error (MPE) counts as 2 σ. Where a maker gives one figure, a sample has 0.6
of it and what samples have in common 0.8; the squares add up to 1.

A draw belongs to (seed, reflector, commanded joints and attempt of the robot, number of the reading there).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from math import pi, radians
from typing import Any, final
from urllib.parse import parse_qsl, urlsplit

from sims.world.errors import generator

ARCSEC = pi / 648_000
UM_PER_M = 1e-6 / ARCSEC
"""A micrometre across at one metre, arc seconds."""

OWN, SHARED = 0.6, 0.8


@final
@dataclass(frozen=True, slots=True)
class Part:
    """1 σ: across the beam `across_mm` + `arcsec`, along it `range_mm` + `range_ppm` · distance."""

    arcsec: float
    across_mm: float
    range_mm: float
    range_ppm: float

    def angle_rad(self, distance_mm: float) -> float:
        """Across the beam, as an angle at the instrument."""
        return self.arcsec * ARCSEC + self.across_mm / distance_mm

    def along_mm(self, distance_mm: float) -> float:
        """Along the beam."""
        return self.range_mm + self.range_ppm * 1e-6 * distance_mm

    def times(self, share: float) -> Part:
        """A share of it."""
        return Part(self.arcsec * share, self.across_mm * share, self.range_mm * share, self.range_ppm * share)


@final
@dataclass(frozen=True, slots=True)
class Profile:
    """sample: drawn for each reading. common: of all readings.

    The common part across the beam is of a reflector at one pose of the robot, along it of the whole set-up.
    least_mm, most_mm: shortest and longest distance that it measures.
    """

    model: str
    sample: Part
    common: Part
    least_mm: float
    most_mm: float


def _of_one_figure(model: str, figure: Part, least_mm: float, most_mm: float) -> Profile:
    return Profile(model, figure.times(OWN), figure.times(SHARED), least_mm, most_mm)


PROFILES = {
    # angle 0.5″ (ISO 17123-3); distance 0.6 mm + 1 ppm at worst, typically 0.2 mm; pointing of the target recognition
    "tdra6000": Profile("TDRA6000", Part(0.5, 0.0, 0.12, 0.0), Part(0.2, 0.05, 0.16, 1.0), 1_500.0, 200_000.0),
    # MPE 15 µm + 6 µm/m, AIFM 0.5 µm/m
    "at960": _of_one_figure("AT960 noise only", Part(3 * UM_PER_M, 0.0075, 0.0075, 0.25), 300.0, 20_000.0),
    # MPE: angle 20 µm + 5 µm/m, ADM 16 µm + 0.8 µm/m
    "vantage": _of_one_figure("Vantage noise only", Part(2.5 * UM_PER_M, 0.010, 0.008, 0.4), 300.0, 35_000.0),
}

DEFAULT = "tdra6000"

FIELD_OF_VIEW_RAD = radians(0.7)
"""Half angle within which the camera of the target recognition sees a reflector without a search."""

BEAM_RAD = 1e-3
"""Half angle of the distance meter's beam: a reflector further from the telescope's axis sends nothing back."""


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


BAUD = 9_600
"""Of an address without `baud`: what instruments are delivered with."""


def baud_of(address: str) -> int:
    """Of the serial line, as the address has it. Raises ValueError where that is no whole number."""
    return int(_query(address).get("baud", BAUD))


def profile_of(address: str) -> str:
    """Name of the noise profile, as the address has it."""
    return _query(address).get("accuracy", DEFAULT)


def _query(address: str) -> dict[str, str]:
    return dict(parse_qsl(urlsplit(address).query))
