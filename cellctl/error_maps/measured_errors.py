"""The rows of an error map: checked, and standardised as the paper standardises them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self, final

import numpy as np

from cellctl.kinematics import Floats

ROWS_AT_LEAST = 5

OUTLYING = 20.0
"""An error this many robust standard deviations (1.48 × median distance from the median) from the others' median on any
axis is a wrong row: an interpolation would spread it over all postures near it."""

LEAST_MM = 1e-6
"""Differences of errors below this are rounding."""

LEAST_RAD = 1e-6
"""A joint that scatters less than this never moved."""


@final
@dataclass(frozen=True, eq=False)
class Scale:
    """Mean and standard deviation (K,) of columns. Of a column without scatter it is 0: its standardised value is 0."""

    mean: Floats
    deviation: Floats

    @classmethod
    def of(cls, values: Floats, least: float) -> Self:
        """Of values (N, K); a scatter below `least` is none."""
        deviation = values.std(axis=0)
        return cls(values.mean(axis=0), np.where(deviation < least, 0.0, deviation))

    def standardised(self, values: Floats) -> Floats:
        """Values (..., K) without a unit."""
        away = values - self.mean
        return np.asarray(np.divide(away, self.deviation, out=np.zeros_like(away), where=self.deviation > 0.0))


def checked(q: Floats, errors: Floats) -> tuple[Floats, Floats]:
    """Angles (N, n), rad, and errors (N, 3), mm, as arrays of float.

    Raises ValueError for shapes that do not match, for numbers that are not finite, for fewer than `ROWS_AT_LEAST`
    rows, for rows that all have the same posture, and for an error far from all others (`OUTLYING`). Repeated postures
    are no mistake.
    """
    q, errors = np.asarray(q, float), np.asarray(errors, float)
    if q.ndim != 2 or errors.shape != (len(q), 3):
        raise ValueError(f"angles {q.shape} and errors {errors.shape} do not match: give (N, n) and (N, 3)")
    if wrong := np.flatnonzero(~(np.isfinite(q).all(axis=1) & np.isfinite(errors).all(axis=1))).tolist():
        raise ValueError(f"row {wrong[0] + 1} has a number that is not finite: remove it or measure it again")
    if len(q) < ROWS_AT_LEAST:
        raise ValueError(f"{len(q)} rows make no error map: measure at least {ROWS_AT_LEAST}")
    if (np.ptp(q, axis=0) < LEAST_RAD).all():
        raise ValueError("all rows have the same posture: measure postures that differ")
    _refuse_outliers(errors)
    return q, errors


def _refuse_outliers(errors: Floats) -> None:
    away = np.abs(errors - np.median(errors, axis=0))
    usual = np.maximum(1.4826 * np.median(away, axis=0), LEAST_MM)
    row, axis = np.unravel_index(np.argmax(away / usual), away.shape)
    if away[row, axis] > OUTLYING * usual[axis]:
        raise ValueError(
            f"row {row + 1}: its {'xyz'[axis]} error of {errors[row, axis]:.3f} mm is {away[row, axis]:.3f} mm from "
            f"the median of all rows, which scatter by {usual[axis]:.3f} mm: remove this row or measure it again"
        )
