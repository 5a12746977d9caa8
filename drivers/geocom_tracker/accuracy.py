"""Accuracy profiles of instruments, 1 σ. The address names one: `accuracy=tdra6000`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Self, final

_ARCSEC: Final = math.radians(1.0 / 3600.0)


@final
@dataclass(frozen=True, slots=True)
class Sigma:
    """1 σ; the parts are added, as the makers state them.

    Across the beam, in each direction: across_mm + angle_rad · distance. Along it: range_mm + range_ppm · distance.
    """

    across_mm: float
    angle_rad: float
    range_mm: float
    range_ppm: float

    def across_at(self, distance_mm: float) -> float:
        """Across the beam, mm."""
        return self.across_mm + self.angle_rad * distance_mm

    def along_at(self, distance_mm: float) -> float:
        """Along the beam, mm."""
        return self.range_mm + self.range_ppm * 1e-6 * distance_mm

    def times(self, share: float) -> Self:
        """A share of it."""
        return type(self)(self.across_mm * share, self.angle_rad * share, self.range_mm * share, self.range_ppm * share)


@final
@dataclass(frozen=True, slots=True)
class Accuracy:
    """sample: of one reading, independent of the others. common: of all readings of a point.

    Along the beam the common part is of the whole set-up, across it of one aim (pointing).

    noise_only: an instrument of this class does not speak GeoCOM: the profile is its noise, not its behaviour.
    one_face_rad: collimation and index error, which remain if one face is used.
    """

    name: str
    sample: Sigma
    common: Sigma
    noise_only: bool
    one_face_rad: float = 3.0 * _ARCSEC


def _noise_of(name: str, figure: Sigma) -> Accuracy:
    """The makers do not divide their figures: 0.6 of σ is taken for a sample, 0.8 as common (0.6² + 0.8² = 1)."""
    return Accuracy(name, figure.times(0.6), figure.times(0.8), noise_only=True)


_ALL: Final = (
    # Angle 0.5″ (ISO 17123-3); distance 0.6 mm + 1 ppm at worst, 0.2 mm typically (0.12² + 0.16² = 0.2²); pointing of
    # the target recognition.
    Accuracy(
        "tdra6000",
        sample=Sigma(across_mm=0.0, angle_rad=0.5 * _ARCSEC, range_mm=0.12, range_ppm=0.0),
        common=Sigma(across_mm=0.05, angle_rad=0.2 * _ARCSEC, range_mm=0.16, range_ppm=1.0),
        noise_only=False,
    ),
    # Half of the MPE: a point ± 15 µm + 6 µm/m; distance meter ± 0.5 µm/m.
    _noise_of("at960", Sigma(across_mm=0.0075, angle_rad=3e-6, range_mm=0.0075, range_ppm=0.25)),
    # Half of the MPE: across ± 20 µm + 5 µm/m; distance ± 16 µm + 0.8 µm/m.
    _noise_of("vantage", Sigma(across_mm=0.01, angle_rad=2.5e-6, range_mm=0.008, range_ppm=0.4)),
)

PROFILES: Final[dict[str, Accuracy]] = {profile.name: profile for profile in _ALL}
