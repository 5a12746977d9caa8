"""Certified distances, their prediction from the rows, and contradictions between them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self, final

import numpy as np

from cellctl.calibration.estimation.estimate import Estimate
from cellctl.calibration.rows import SpacingRows
from cellctl.kinematics import Bools, Floats

FAR = 6.0
"""A distance contradicts the rows from this many standard deviations (certificate and prediction together)."""

LEAST_MM = 0.3
"""A smaller difference is no contradiction: the robot may bend that much, and the model is geometry alone."""


@final
@dataclass(frozen=True, eq=False)
class PredictedSpacings:
    """K distances, mm, as given and as estimated from rows alone; the covariance (K, K) of the estimates, mm², model
    errors included, and the σ (K,) of the given distances.
    """

    given: Floats
    estimate: Floats
    covariance: Floats
    sigma: Floats

    @classmethod
    def of(cls, spacings: SpacingRows, found: Estimate, errors: Floats) -> Self:
        """From a robot and points that were `found` without `spacings`; errors (K, K), mm²: `model_errors`."""
        state = found.state
        lines = spacings.jacobian(state)[:, 0]
        estimate = spacings.mm + spacings.residual(state)[:, 0]
        return cls(spacings.mm, estimate, lines @ found.covariance @ lines.T + errors, spacings.sigma[:, 0])

    @property
    def away(self) -> Floats:
        """Each given distance minus its estimate (K,), mm."""
        return self.given - self.estimate

    @property
    def spread(self) -> Floats:
        """The covariance (K, K) of `away`."""
        return np.asarray(self.covariance + np.diag(self.sigma**2))

    def scaled(self, factor: float) -> Self:
        """The same with the given distances times `factor`."""
        return replace(self, given=self.given * factor, sigma=self.sigma * factor)

    def contradicted(self) -> Bools:
        """Which distances (K,) contradict the rows alone."""
        return np.asarray(_ratio(self.away, np.sqrt(np.diag(self.spread))) > 1.0)

    def given_others(self, kept: Bools, one: int) -> tuple[float, float]:
        """Error of distance `one`, mm, given rows and the other `kept` ones (K,), and its 1 σ."""
        chosen = np.append(np.flatnonzero(kept & (np.arange(len(kept)) != one)), one)
        off, sigma = _off(np.linalg.inv(self.spread[np.ix_(chosen, chosen)]), self.away[chosen])
        return float(off[-1]), float(sigma[-1])


def wrong(predicted: PredictedSpacings) -> tuple[Bools, Bools]:
    """Which distances (K,) are wrong, and for which (K,) of these that is certain.

    Distances that are wrong by one factor agree with each other, so they are first compared with the rows alone.
    """
    contradicted = predicted.contradicted()
    certain = contradicted.copy()
    kept = np.flatnonzero(~contradicted)
    if kept.size:
        contradicted[kept], sure = _contradicting(predicted.away[kept], predicted.spread[np.ix_(kept, kept)])
        certain[kept] = contradicted[kept] & sure
    return contradicted, certain


def _contradicting(away: Floats, spread: Floats) -> tuple[Bools, bool]:
    """Which distances (K,) contradict the others and the rows, and whether it is certain that these are wrong."""
    weight: Floats = np.asarray(np.linalg.inv(spread), float)
    kept = np.ones(len(away), bool)
    if not (_ratio(*_off(weight, away)) > 1.0).any():
        return ~kept, True
    cures = np.array([not (_ratio(*_off(_without(weight, one), away)) > 1.0).any() for one in range(len(away))])
    if cures.any():
        return cures, int(np.count_nonzero(cures)) == 1
    while (ratio := _ratio(*_off(weight, away))).max() > 1.0:
        one = int(np.argmax(ratio))
        weight, kept[one] = _without(weight, one), False
    return ~kept, True


def _ratio(off: Floats, sigma: Floats) -> Floats:
    """Each error as a multiple of the accepted limit."""
    return np.asarray(np.abs(off) / np.maximum(FAR * sigma, LEAST_MM))


def _off(weight: Floats, away: Floats) -> tuple[Floats, Floats]:
    """Error of each (K,), given all others, and its 1 σ; `weight` (K, K): inverse covariance of `away`. For a distance
    that was taken out: 0 ± ∞.
    """
    own = np.diag(weight)
    there = own > 0.0
    variance = np.where(there, 1.0 / np.where(there, own, 1.0), np.inf)
    return np.where(there, weight @ away, 0.0) * np.where(there, variance, 0.0), np.sqrt(variance)


def _without(weight: Floats, one: int) -> Floats:
    """The inverse covariance without distance `one`, whose row and column are then 0."""
    result = weight - np.outer(weight[one], weight[one]) / weight[one, one]
    result[one], result[:, one] = 0.0, 0.0
    return np.asarray(result)
