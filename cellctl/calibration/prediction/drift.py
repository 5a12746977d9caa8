"""Drift from repeats of one touch: its rate by touch number, and whether it is more than scatter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.kinematics import Floats

SIGNIFICANT = 0.01
"""Significance level: scatter alone is taken for drift in one campaign in a hundred."""

KNOWN_FROM = 30
"""Cycles from which a robot's repeatability counts as known (ISO 9283 requires 30)."""


@final
@dataclass(frozen=True, slots=True)
class Drift:
    """A straight line through the visits to one touch.

    mm_per_touch: change of the shift along the normal with each touch, with its 1 σ; t: their ratio; significant:
    whether it exceeds scatter; visits: their count, with the first.
    """

    mm_per_touch: float
    sigma: float
    t: float
    significant: bool
    visits: int

    def at(self, touch: ArrayLike) -> Floats:
        """Shift (N,), mm, at touch numbers (N,) against touch 0."""
        return np.asarray(np.asarray(touch, float) * self.mm_per_touch)


def linear_drift(touch: ArrayLike, shift_mm: ArrayLike, sigma_mm: float) -> Drift:
    """The drift through visits at touch numbers (V,) with shifts (V,), mm, each with 1 σ `sigma_mm`.

    t test of the slope. Its scatter is pooled from the prior `sigma_mm`, with `KNOWN_FROM` cycles, and the visits about
    the line, with V − 2: a few visits alone give a poor estimate. Fewer than three visits show no drift.
    """
    from scipy.stats import t as student

    number, shift = np.asarray(touch, float), np.asarray(shift_mm, float)
    visits = int(number.size)
    if visits < 3 or np.ptp(number) == 0.0:
        return Drift(0.0, 0.0, 0.0, False, visits)
    away = number - number.mean()
    spread = float(away @ away)
    slope = float(away @ shift) / spread
    residual = shift - shift.mean() - slope * away
    freedom = KNOWN_FROM + visits - 2
    scatter = float(np.sqrt((KNOWN_FROM * sigma_mm**2 + residual @ residual) / freedom))
    sigma = scatter / spread**0.5
    ratio = slope / sigma
    significant = abs(ratio) > float(student.ppf(1.0 - SIGNIFICANT / 2.0, freedom))
    return Drift(slope, sigma, ratio, bool(significant), visits)
