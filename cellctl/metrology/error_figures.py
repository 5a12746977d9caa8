"""Figures of position errors: by direction, their intervals from their own scatter, and the floor of a cell.

The targets count as drawn at random from those that the robot will go to. An interval of the greatest error has no such
meaning; instead the share of further targets below it is bounded without a distribution: F(max)^n ≥ 1 − 0.95 (Wilks).

Ratios are of root mean squares, by the same statistic on the same rows. A ratio of 1 cannot be improved; sixty
parameters from 480 numbers alone cost a factor of 1.06.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.calibration.distributions import maxwell_cdf, normal_ppf, t_ppf
from cellctl.kinematics import Floats


@final
@dataclass(frozen=True, slots=True)
class ErrorDirections:
    """RMS of N errors by direction, mm: x, y, z (vertical) of the base frame, radial (from A1's axis), tangential.

    scale_ppm, scale_sigma_ppm: the factor by which the true places are further apart than the model's, with 1 σ.
    """

    x: float
    y: float
    z: float
    radial: float
    tangential: float
    scale_ppm: float
    scale_sigma_ppm: float


def error_directions(places: Floats, errors: Floats, registration: Floats) -> ErrorDirections:
    """Directions of `errors` (N, 3) at `places` (N, 3), mm, both in the base frame.

    registration (N, 3, R): how the places follow the parameters that registered the model. The scale is found together
    with these parameters, e = s p + J x: a registered reflector offset takes up a part of a wrong scale otherwise. Its
    σ is from the scatter that is left. Raises ValueError with fewer than R + 2 numbers.
    """
    x, y, z = np.sqrt(np.mean(errors**2, axis=0)).tolist()
    out = places[:, :2] / np.linalg.norm(places[:, :2], axis=1, keepdims=True)
    radial = np.sum(errors[:, :2] * out, axis=1)
    tangential = errors[:, 1] * out[:, 0] - errors[:, 0] * out[:, 1]
    return ErrorDirections(x, y, z, _rms(radial), _rms(tangential), *_scale(places, errors, registration))


def _scale(places: Floats, errors: Floats, registration: Floats) -> tuple[float, float]:
    """The scale and its 1 σ, ppm."""
    if errors.size < registration.shape[-1] + 2:
        raise ValueError(f"{len(errors)} places do not show a scale beside {registration.shape[-1]} other parameters")
    basis = np.linalg.qr(registration.reshape(errors.size, -1))[0]
    away, off = (flat - basis @ (basis.T @ flat) for flat in (places.ravel(), errors.ravel()))
    spread = float(away @ away)
    scale = float(away @ off) / spread
    rest = off - scale * away
    variance = float(rest @ rest) / (errors.size - basis.shape[1] - 1)
    return 1e6 * scale, 1e6 * float(np.sqrt(variance / spread))


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


@final
@dataclass(frozen=True, slots=True)
class ErrorIntervals:
    """95 % intervals of mean and RMS, mm. share_below: with 95 % confidence, at least this share of further errors is
    below the greatest one.
    """

    mean: tuple[float, float]
    rms: tuple[float, float]
    share_below: float

    @classmethod
    def of(cls, errors_mm: ArrayLike) -> ErrorIntervals:
        """Of 3-D errors (N,), mm: Student's interval of the mean; of the RMS by the logarithm of the mean square.

        Raises ValueError for fewer than two errors.
        """
        errors = np.asarray(errors_mm, float)
        if errors.ndim != 1 or len(errors) < 2:
            raise ValueError("intervals need two errors or more")
        squares = errors**2
        mean, half = float(errors.mean()), _half(errors)
        rms = float(np.sqrt(squares.mean()))
        spread = float(np.exp(_half(squares) / squares.mean() / 2.0)) if rms > 0.0 else 1.0
        return cls(
            (max(0.0, mean - half), mean + half), (rms / spread, rms * spread), float(0.05 ** (1.0 / len(errors)))
        )


def _half(values: np.ndarray) -> float:
    """Half of Student's 95 % interval of the mean of `values` (N,)."""
    count = len(values)
    return float(t_ppf(0.975, count - 1) * values.std(ddof=1) / np.sqrt(count))


@final
@dataclass(frozen=True, slots=True)
class FloorRatio:
    """rms_mm of the model; floor_mm: RMS of the floor; ratio, with its 95 % interval low … high."""

    rms_mm: float
    floor_mm: float
    ratio: float
    low: float
    high: float


def floor_ratio(errors_mm: ArrayLike, floor_mm: ArrayLike) -> FloorRatio:
    """Of 3-D errors (N,), mm, of a model and of the exact truth on the same rows (paired).

    The interval is a normal one on the logarithm of the ratio, from the paired squares (delta method). Raises
    ValueError for unpaired or empty errors, or a floor of 0.
    """
    errors, floor = np.asarray(errors_mm, float) ** 2, np.asarray(floor_mm, float) ** 2
    if errors.shape != floor.shape or errors.ndim != 1 or len(errors) < 2 or not floor.sum() > 0.0:
        raise ValueError("the floor needs the errors of model and truth on the same two or more rows")
    ratio = float(np.sqrt(errors.mean() / floor.mean()))
    spread = errors / errors.mean() - floor / floor.mean() if errors.any() else np.zeros(len(errors))
    half = 0.5 * float(spread.std(ddof=1)) / np.sqrt(len(errors)) * float(normal_ppf(0.975))
    rms, of_floor = float(np.sqrt(errors.mean())), float(np.sqrt(floor.mean()))
    return FloorRatio(rms, of_floor, ratio, float(ratio * np.exp(-half)), float(ratio * np.exp(half)))


def expected_floor(noise_3d_rms_mm: float, rows: int) -> tuple[float, float]:
    """Expected mean and maximum, mm, of the floor over `rows` rows with isotropic noise of this 3-D RMS.

    With σ = RMS / √3 on each axis: mean σ √(8/π); the maximum by ∫ 1 − F(x)^N dx, F the Maxwell distribution.
    """
    sigma = noise_3d_rms_mm / np.sqrt(3.0)
    x = np.linspace(0.0, 12.0, 12001)
    largest = np.trapezoid(1.0 - maxwell_cdf(x) ** rows, x)
    return float(sigma * np.sqrt(8.0 / np.pi)), float(sigma * largest)
