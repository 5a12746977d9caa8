"""The stand-offs in the journal: the distance of each target from its place by the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self, final

import numpy as np

from cellctl.kinematics import Floats
from procedures.steps.sphere.rows import StandOffRow


@final
@dataclass(frozen=True, eq=False)
class StandOffErrors:
    """N stand-offs. numbers (N,): of the targets. errors (N,): travel to contact less intended distance, mm, signed.

    predicted (N,): error predicted by the model; sigma (N,): 1 σ of the rest, mm.
    """

    numbers: Floats
    errors: Floats
    predicted: Floats
    sigma: Floats

    @classmethod
    def of(cls, rows: Sequence[StandOffRow], run: str) -> Self:
        """The rows of one run, `before` or `after`."""
        mine = [row for row in rows if row.run == run]
        columns = ([row.number for row in mine], [row.error_mm for row in mine])
        known = ([row.expected_mm for row in mine], [row.sigma_mm for row in mine])
        return cls(*(np.array(column, float) for column in (*columns, *known)))

    @property
    def rest(self) -> Floats:
        """The errors (N,), mm, less their prediction."""
        return np.asarray(self.errors - self.predicted)

    @property
    def found_sigma(self) -> float:
        """RMS of `rest`, mm, to be compared with the predicted σ; NaN without rows."""
        return _rms(self.rest)

    @property
    def predicted_sigma(self) -> float:
        """RMS of the predicted σ, mm; NaN without rows."""
        return _rms(self.sigma)

    @property
    def within_two_sigma(self) -> float | None:
        """Share of `rest` within ±2 predicted σ; None without rows."""
        return float(np.mean(np.abs(self.rest) <= 2.0 * self.sigma)) if self.errors.size else None


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")
