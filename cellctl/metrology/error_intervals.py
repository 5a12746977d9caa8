"""How sure the figures of measured errors are, from their own scatter.

The targets count as drawn at random from those that the robot will go to. An interval of the greatest error has no such
meaning; instead the share of further targets below it is bounded without a distribution: F(max)^n ≥ 1 − 0.95 (Wilks).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats


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
    return float(stats.t.ppf(0.975, count - 1) * values.std(ddof=1) / np.sqrt(count))
