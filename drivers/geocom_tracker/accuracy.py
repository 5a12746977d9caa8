"""Accuracy profiles of instruments, 1 σ. The address names one: `accuracy=tdra6000`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, final

_ARCSEC: Final = math.radians(1.0 / 3600.0)


@final
@dataclass(frozen=True, slots=True)
class Accuracy:
    """1 σ of an instrument. `sample_…`: independent from sample to sample; `set_up_…`: the same for all samples.

    along the beam: sample_range_mm; set_up_zero_mm + set_up_scale_ppm · distance (added in squares).
    across the beam, each direction: sample_across_mm and sample_angle_rad · distance; set_up_across_mm and
    set_up_angle_rad · distance; one_face_rad · distance more if one face is used (collimation, index error).
    noise_only: an instrument of this class does not speak GeoCOM: the profile is its noise, not its behaviour.
    """

    name: str
    sample_range_mm: float
    sample_across_mm: float
    sample_angle_rad: float
    set_up_zero_mm: float
    set_up_scale_ppm: float
    set_up_across_mm: float
    set_up_angle_rad: float
    one_face_rad: float
    noise_only: bool


_ALL: Final = (
    # 0.5″ (ISO 17123-3); distance 0.6 mm + 1 ppm at worst, 0.2 mm typically, of which 0.1 mm changes from sample to
    # sample; pointing of the target recognition at an SMR 0.05 mm.
    Accuracy(
        name="tdra6000",
        sample_range_mm=0.1,
        sample_across_mm=0.0,
        sample_angle_rad=0.5 * _ARCSEC,
        set_up_zero_mm=0.17,
        set_up_scale_ppm=1.0,
        set_up_across_mm=0.05,
        set_up_angle_rad=0.25 * _ARCSEC,
        one_face_rad=0.5 * _ARCSEC,
        noise_only=False,
    ),
    # MPE of a point ± 15 µm + 6 µm/m, of the distance meter ± 0.5 µm/m; 1 σ is half of the MPE, half of that variance
    # is common.
    Accuracy(
        name="at960",
        sample_range_mm=0.0053,
        sample_across_mm=0.0053,
        sample_angle_rad=2.1e-6,
        set_up_zero_mm=0.0053,
        set_up_scale_ppm=0.25,
        set_up_across_mm=0.0053,
        set_up_angle_rad=2.1e-6,
        one_face_rad=0.0,
        noise_only=True,
    ),
    # Distance ± 16 µm + 0.8 µm/m, across ± 20 µm + 5 µm/m (MPE); divided as above.
    Accuracy(
        name="vantage",
        sample_range_mm=0.0057,
        sample_across_mm=0.0071,
        sample_angle_rad=1.8e-6,
        set_up_zero_mm=0.0057,
        set_up_scale_ppm=0.4,
        set_up_across_mm=0.0071,
        set_up_angle_rad=1.8e-6,
        one_face_rad=0.0,
        noise_only=True,
    ),
)

PROFILES: Final[dict[str, Accuracy]] = {profile.name: profile for profile in _ALL}
