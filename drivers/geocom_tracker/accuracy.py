"""Accuracy profiles of instruments, 1 σ. The address names one: `accuracy=tdra6000`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, final

_ARCSEC: Final = math.radians(1.0 / 3600.0)


@final
@dataclass(frozen=True, slots=True)
class Accuracy:
    """1 σ of one reading.

    Along the beam: range_mm + range_ppm · distance; across it: across_mm and angle_rad · distance, squares added.
    one_face_rad: collimation and index error, which remain if one face is used.
    noise_only: an instrument of this class does not speak GeoCOM: the profile is its noise, not its behaviour.
    """

    name: str
    range_mm: float
    range_ppm: float
    across_mm: float
    angle_rad: float
    noise_only: bool
    one_face_rad: float = 3.0 * _ARCSEC

    def along_mm(self, distance_mm: float) -> float:
        """1 σ along the beam, mm."""
        return self.range_mm + self.range_ppm * 1e-6 * distance_mm

    def across_mm_at(self, distance_mm: float) -> float:
        """1 σ across the beam, in each direction, mm."""
        return math.hypot(self.across_mm, self.angle_rad * distance_mm)


SAMPLE_SHARE: Final = 0.8
"""Of each σ: what changes from sample to sample. The makers do not divide their figures."""
COMMON_SHARE: Final = 0.6
"""Of each σ: what is the same for all samples of a point. 0.8² + 0.6² = 1."""

_ALL: Final = (
    # 0.5″ (ISO 17123-3); distance 0.6 mm + 1 ppm at worst, 0.2 mm typically.
    Accuracy("tdra6000", range_mm=0.2, range_ppm=1.0, across_mm=0.0, angle_rad=0.5 * _ARCSEC, noise_only=False),
    # Half of the MPE: a point ± 15 µm + 6 µm/m; distance meter ± 5 µm (R0), ± 0.5 µm/m.
    Accuracy("at960", range_mm=0.0025, range_ppm=0.25, across_mm=0.0075, angle_rad=3e-6, noise_only=True),
    # Half of the MPE: distance ± 16 µm + 0.8 µm/m, across ± 20 µm + 5 µm/m.
    Accuracy("vantage", range_mm=0.008, range_ppm=0.4, across_mm=0.01, angle_rad=2.5e-6, noise_only=True),
)

PROFILES: Final[dict[str, Accuracy]] = {profile.name: profile for profile in _ALL}
