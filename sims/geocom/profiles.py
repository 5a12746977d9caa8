"""How accurate the instrument is: figures of protocols.md 2.6, each split into parts with different causes.

The figures are 1 σ. A maximum permissible error (MPE) counts as 2 σ. A figure is the square sum of what changes from
sample to sample (0.8 of it) and of what does not (0.6).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, pi, radians
from typing import final

SAMPLE, COMMON = 0.8, 0.6
"""Shares of a figure; their squares add up to 1."""

ARCSEC = pi / 648_000


@final
@dataclass(frozen=True, slots=True)
class Profile:
    """1 σ, all parts together. Across the beam: `angle_arcsec` and `across_mm`; along it: `range_mm`, `range_ppm`.

    least_mm, most_mm: shortest and longest distance that it measures.
    """

    model: str
    angle_arcsec: float
    across_mm: float
    range_mm: float
    range_ppm: float
    least_mm: float
    most_mm: float

    def angle_rad(self, distance_mm: float) -> float:
        """1 σ of a direction, rad, as an angle at the instrument."""
        return hypot(self.angle_arcsec * ARCSEC, self.across_mm / distance_mm)


PROFILES = {
    # angle 0.5″ (ISO 17123-3); distance 0.6 mm + 1 ppm at worst, typically 0.2 mm
    "tdra6000": Profile("TDRA6000", 0.5, 0.0, 0.2, 1.0, 1_500.0, 200_000.0),
    # MPE 15 µm + 6 µm/m, AIFM 0.5 µm/m; along the beam R0 5 µm (of the AT500)
    "at960": Profile("AT960 noise only", 3e-6 / ARCSEC, 0.0075, 0.0025, 0.25, 300.0, 20_000.0),
    # MPE: angle 20 µm + 5 µm/m, ADM 16 µm + 0.8 µm/m
    "vantage": Profile("Vantage noise only", 2.5e-6 / ARCSEC, 0.010, 0.008, 0.4, 300.0, 35_000.0),
}

DEFAULT = "tdra6000"

FIELD_OF_VIEW_RAD = radians(0.7)
"""Half angle within which the camera of the target recognition sees a reflector without a search."""

BEAM_RAD = 1e-3
"""Half angle of the distance meter's beam: a reflector further from the telescope's axis sends nothing back."""
