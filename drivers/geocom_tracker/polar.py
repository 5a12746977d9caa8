"""From polar readings to a point with its covariance, in closed form.

Frame of the instrument: right-handed; z up along its standing axis; y at hz = 0; x at hz = 90°. hz grows clockwise seen
from above, v is the zenith angle: x = D sin v sin hz, y = D sin v cos hz, z = D cos v (GeoCOM: east, north, height).
The origin is where the axes cross.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, cast, final

import numpy as np
from numpy.typing import NDArray

from cellctl.devices import Matrix3, Vector3
from drivers.geocom_tracker.accuracy import Accuracy

_REFRACTION_RAD_PER_MM: Final = 0.15e-9
"""1 σ of the bend of the beam: half of 1e-6/K times a gradient of 0.3 K/m across the beam, per distance."""
_CLEARLY_LARGER: Final = 2.0
"""The samples' standard deviation replaces the profile's if it is more than this times as large."""


@final
@dataclass(frozen=True, slots=True)
class Polar:
    """Direction and distance: hz clockwise, v from the zenith, rad; slope distance, mm."""

    hz: float
    v: float
    range_mm: float


def to_xyz(polar: Polar) -> Vector3:
    """x, y, z in the instrument's frame, mm."""
    across = polar.range_mm * math.sin(polar.v)
    return (across * math.sin(polar.hz), across * math.cos(polar.hz), polar.range_mm * math.cos(polar.v))


def to_polar(place: Vector3) -> Polar:
    """Direction and distance of a place in the instrument's frame, hz in [0, 2π). Raises ValueError for the origin."""
    distance = math.hypot(*place)
    if not 0.0 < distance < math.inf:
        raise ValueError(f"{place} is no place to aim at: it has no direction")
    return Polar(math.atan2(place[0], place[1]) % math.tau, math.acos(place[2] / distance), distance)


def first_face(polar: Polar) -> Polar:
    """The direction as the first face reads it: the second face reads hz + π and 2π − v."""
    return Polar((polar.hz - math.pi) % math.tau, math.tau - polar.v, polar.range_mm) if polar.v > math.pi else polar


def mean_of(readings: Sequence[Polar]) -> Polar:
    """Mean of readings close to each other; hz is averaged from the first one on, so that 0 = 2π does no harm."""
    hz = readings[0].hz + _mean([_turned(one.hz - readings[0].hz) for one in readings])
    return Polar(hz % math.tau, _mean([one.v for one in readings]), _mean([one.range_mm for one in readings]))


def deviations(readings: Sequence[Polar]) -> list[Vector3]:
    """Of each reading from their mean, mm: along the beam, across it horizontally (clockwise), across it downwards."""
    mean = mean_of(readings)
    across = mean.range_mm * math.sin(mean.v)
    return [
        (one.range_mm - mean.range_mm, across * _turned(one.hz - mean.hz), mean.range_mm * (one.v - mean.v))
        for one in readings
    ]


def scatter_of(deviating: Sequence[Vector3], means: int) -> Vector3:
    """1 σ of one sample from its deviations from `means` means (one per face); 0 without spare samples."""
    spare = len(deviating) - means
    if spare < 1:
        return (0.0, 0.0, 0.0)
    along, horizontal, vertical = (math.sqrt(sum(d[axis] ** 2 for d in deviating) / spare) for axis in range(3))
    return (along, horizontal, vertical)


def covariances(
    mean: Polar, accuracy: Accuracy, *, samples: int, faces: int, scatter: Vector3, centring_mm: float
) -> tuple[Matrix3, Matrix3]:
    """Covariance of a point of `samples` readings in all, and the part that all points of the set-up share; mm².

    More samples reduce neither that part nor the pointing, which is new with each aim.
    scatter: as found, along, horizontally, vertically; it replaces the profile's where it is clearly larger.
    centring_mm: 1 σ of the reflector's centre. Cov = R diag(σ²) Rᵀ, R: unit vectors along and across the beam.
    """
    distance = mean.range_mm
    stated = _sample_sigma(accuracy, distance)
    sample = [found if found > _CLEARLY_LARGER * own else own for found, own in zip(scatter, stated, strict=True)]
    common = np.array(_common_variance(accuracy, distance, faces)) + centring_mm**2
    axes = _beam_axes(mean)
    return (
        _matrix(axes @ np.diag(common + _aim_variance(accuracy, distance) + np.square(sample) / samples) @ axes.T),
        _matrix(axes @ np.diag(common) @ axes.T),
    )


def _sample_sigma(accuracy: Accuracy, distance: float) -> Vector3:
    across = accuracy.sample.across_at(distance)
    return (accuracy.sample.along_at(distance), across, across)


def _common_variance(accuracy: Accuracy, distance: float, faces: int) -> Vector3:
    along = accuracy.common.along_at(distance)
    one_face = accuracy.one_face_rad if faces == 1 else 0.0
    refraction = _REFRACTION_RAD_PER_MM * distance
    across = math.hypot(one_face, refraction) * distance
    return (along**2, across**2, across**2)


def _aim_variance(accuracy: Accuracy, distance: float) -> Vector3:
    across = accuracy.common.across_at(distance)
    return (0.0, across**2, across**2)


def _beam_axes(mean: Polar) -> NDArray[np.float64]:
    """Columns: unit vectors along the beam, across it clockwise, across it downwards."""
    sin_hz, cos_hz, sin_v, cos_v = math.sin(mean.hz), math.cos(mean.hz), math.sin(mean.v), math.cos(mean.v)
    return np.array(
        [
            [sin_v * sin_hz, cos_hz, cos_v * sin_hz],
            [sin_v * cos_hz, -sin_hz, cos_v * cos_hz],
            [cos_v, 0.0, -sin_v],
        ]
    )


def _matrix(array: NDArray[np.float64]) -> Matrix3:
    return cast(Matrix3, tuple(tuple(float(value) for value in row) for row in (array + array.T) / 2.0))


def _turned(angle: float) -> float:
    """The angle in [−π, π)."""
    return (angle + math.pi) % math.tau - math.pi


def _mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values)
