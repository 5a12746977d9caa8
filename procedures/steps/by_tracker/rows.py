"""Rows of a model judged by a tracker that took no part in its identification. Lengths in mm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, final

from cellctl.records import Figures, Row
from procedures.steps.sphere.rows import SphereVerdict

Vectors = tuple[tuple[float, ...], ...]


@final
@dataclass(frozen=True, kw_only=True)
class JudgedPosesRow(Row):
    """N held-out poses: readings (N, n), deg; place (N, 3) in the robot's base frame.

    nominal, touches, tracker (N, 3): measured place less that of the nominal robot, of the model from the touches, and
    of the model from the tracker's own poses, base frame.
    """

    KIND: ClassVar[str] = "judged poses"
    readings: Vectors
    place: Vectors
    nominal: Vectors
    touches: Vectors
    tracker: Vectors


@final
@dataclass(frozen=True, kw_only=True)
class DirectionFigures:
    """RMS of errors by direction in the base frame, mm, and their change of scale with 1 σ, ppm."""

    x: float
    y: float
    z: float
    radial: float
    tangential: float
    scale_ppm: float
    scale_sigma_ppm: float


@final
@dataclass(frozen=True, kw_only=True)
class JudgedModel:
    """Errors of a model at the held-out poses: figures, and by direction. predicted_rms: by the model's σ, with the
    tracker's; coverage_95: share of the poses in their predicted 95 % region. None: the model states no σ.
    """

    errors: Figures
    directions: DirectionFigures
    predicted_rms: float | None = None
    coverage_95: float | None = None


@final
@dataclass(frozen=True, kw_only=True)
class ByTrackerFigures:
    """The models at `n_test` held-out poses; station frame and reflector offset of each from the same `n_fit` poses."""

    n_fit: int
    n_test: int
    nominal: JudgedModel
    touches: JudgedModel
    tracker: JudgedModel


@final
@dataclass(frozen=True, kw_only=True)
class ByTrackerVerdict(SphereVerdict):
    """The verdict on held-out touches; with `by_tracker`, that of the tracker on the model from the touches.

    accuracy: profile of the instrument; noise_only: of its noise alone.
    """

    SECTION: ClassVar[tuple[str, ...]] = (*SphereVerdict.SECTION, "by_tracker", "accuracy", "noise_only")
    accuracy: str = ""
    noise_only: bool = False
    by_tracker: ByTrackerFigures | None = None
