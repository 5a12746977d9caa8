"""Samples of one reflector in one or both faces, and what follows from them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

from cellctl.devices import MeasuredPoint, TwoFaceError, Weather
from drivers.geocom_tracker.accuracy import Accuracy
from drivers.geocom_tracker.polar import Polar, covariances, deviations, first_face, mean_of, scatter_of, to_xyz

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
