"""From samples in one or both faces to a point with its covariance, in closed form, by the instrument's accuracy.

Frame of the instrument: right-handed; z up along its standing axis; y at hz = 0; x at hz = 90°. hz grows clockwise seen
from above, v is the zenith angle: x = D sin v sin hz, y = D sin v cos hz, z = D cos v (GeoCOM: east, north, height).
The origin is where the axes cross.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Self, cast, final

import numpy as np
from numpy.typing import NDArray

from cellctl.devices import Matrix3, MeasuredPoint, TwoFaceError, Vector3, Weather

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


_TILTED_CODE = 1283


@final
@dataclass(frozen=True, slots=True)
class Sample:
    """One measurement. `code`: done, or a warning. `begun_ns`, `ended_ns`: the cell's time."""

    reading: Polar
    code: int
    warning: str
    device_ms: int
    begun_ns: int
    ended_ns: int

    @property
    def face(self) -> int:
        """1, or 2 with the telescope turned over."""
        return 2 if self.reading.v > math.pi else 1


@final
@dataclass(frozen=True, slots=True)
class SetUp:
    """What is the same for all samples: the instrument's accuracy, the reflector's centring, the air."""

    accuracy: Accuracy
    centring_mm: float
    weather: Weather | None


def order(samples: int, faces: int) -> list[tuple[int, int]]:
    """(face, samples) in the order of measuring: the faces alternate A B b a, so that a steady drift cancels."""
    half = (samples + 1) // 2
    return [(1, samples)] if faces == 1 else [(1, half), (2, samples), (1, samples - half)]


def point_of(samples: Sequence[Sample], set_up: SetUp) -> MeasuredPoint:
    """The point that the samples of one or both faces give."""
    by_face = [[one.reading for one in samples if one.face == face] for face in (1, 2)]
    used = [readings for readings in by_face if readings]
    mean = mean_of([mean_of([first_face(one) for one in readings]) for readings in used])
    scatter = scatter_of([one for readings in used for one in deviations(readings)], len(used))
    covariance, common = covariances(
        mean,
        set_up.accuracy,
        samples=len(samples),
        faces=len(used),
        scatter=scatter,
        centring_mm=set_up.centring_mm,
    )
    raw = mean_of(used[0])
    return MeasuredPoint(
        xyz=to_xyz(mean),
        covariance=covariance,
        common=common,
        samples=len(samples),
        scatter=scatter,
        faces=len(used),
        hz_rad=raw.hz,
        v_rad=raw.v,
        range_mm=raw.range_mm,
        time_ns=(samples[0].begun_ns + samples[-1].ended_ns) // 2,
        device_ms=samples[-1].device_ms,
        levelled=all(one.code != _TILTED_CODE for one in samples),
        weather=set_up.weather,
        accuracy=set_up.accuracy.name,
        noise_only=set_up.accuracy.noise_only,
        warnings=tuple(dict.fromkeys(one.warning for one in samples if one.warning)),
    )


def two_face_error_of(samples: Sequence[Sample]) -> TwoFaceError:
    """Half the difference, first face minus second, of samples in both faces."""
    one, two = (mean_of([first_face(s.reading) for s in samples if s.face == face]) for face in (1, 2))
    hz = ((one.hz - two.hz + math.pi) % math.tau - math.pi) / 2.0
    v = (one.v - two.v) / 2.0
    distance = (one.range_mm + two.range_mm) / 2.0
    return TwoFaceError(
        hz_rad=hz,
        v_rad=v,
        range_mm=(one.range_mm - two.range_mm) / 2.0,
        hz_mm=hz * distance * math.sin(one.v),
        v_mm=v * distance,
    )
