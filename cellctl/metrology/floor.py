"""The floor of a cell: the error that a predictor with the exact mean truth has on the same noisy held-out rows.

Ratios are of root mean squares, by the same statistic on the same rows. A ratio of 1 cannot be improved; sixty
parameters from 480 numbers alone cost a factor of 1.06.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats


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
    half = 0.5 * float(spread.std(ddof=1)) / np.sqrt(len(errors)) * float(stats.norm.ppf(0.975))
    rms, of_floor = float(np.sqrt(errors.mean())), float(np.sqrt(floor.mean()))
    return FloorRatio(rms, of_floor, ratio, float(ratio * np.exp(-half)), float(ratio * np.exp(half)))


def expected_floor(noise_3d_rms_mm: float, rows: int) -> tuple[float, float]:
    """Expected mean and maximum, mm, of the floor over `rows` rows with isotropic noise of this 3-D RMS.

    With σ = RMS / √3 on each axis: mean σ √(8/π); the maximum by ∫ 1 − F(x)^N dx, F the Maxwell distribution.
    """
    sigma = noise_3d_rms_mm / np.sqrt(3.0)
    x = np.linspace(0.0, 12.0, 12001)
    largest = np.trapezoid(1.0 - stats.maxwell.cdf(x) ** rows, x)
    return float(sigma * np.sqrt(8.0 / np.pi)), float(sigma * largest)
