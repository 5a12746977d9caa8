"""Distances as rows foretell them, and which of those that are given these, or the other distances, deny."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self, final

import numpy as np

from cellctl.calibration.estimation.estimate import Estimate
from cellctl.calibration.rows import SpacingRows
from cellctl.kinematics import Bools, Floats

FAR = 6.0
"""Standard deviations, of certificate and foretelling together, from which on a distance is denied."""

LEAST_MM = 0.3
"""Nothing smaller is denied: as much may be what the robot bends, where the model is geometry alone."""


@final
@dataclass(frozen=True, eq=False)
class Foretold:
    """K distances given and said by the rows alone, mm; covariance (K, K) of what is said, and the given ones' σ."""

    given: Floats
    said: Floats
    covariance: Floats
    sigma: Floats

    @classmethod
    def of(cls, spacings: SpacingRows, found: Estimate) -> Self:
        """From a robot and points that were `found` without `spacings`."""
        state = found.state
        lines = spacings.jacobian(state)[:, 0]
        said = spacings.mm + spacings.residual(state)[:, 0]
        return cls(spacings.mm, said, lines @ found.covariance @ lines.T, spacings.sigma[:, 0])

    @property
    def away(self) -> Floats:
        """How far each distance is beyond what the rows alone say (K,), mm."""
        return self.given - self.said

    @property
    def spread(self) -> Floats:
        """The covariance (K, K) of `away`."""
        return np.asarray(self.covariance + np.diag(self.sigma**2))

    def scaled(self, factor: float) -> Self:
        """The same, all that is given times `factor`."""
        return replace(self, given=self.given * factor, sigma=self.sigma * factor)

    def denied(self) -> Bools:
        """Which distances (K,) the rows deny by themselves."""
        return np.asarray(_times(self.away, np.sqrt(np.diag(self.spread))) > 1.0)

    def given_others(self, kept: Bools, one: int) -> tuple[float, float]:
        """How far distance `one` is off, mm, given rows and the other `kept` ones (K,), and the 1 σ of that."""
        chosen = np.append(np.flatnonzero(kept & (np.arange(len(kept)) != one)), one)
        off, sigma = _off(np.linalg.inv(self.spread[np.ix_(chosen, chosen)]), self.away[chosen])
        return float(off[-1]), float(sigma[-1])


def wrong(foretold: Foretold) -> tuple[Bools, Bools]:
    """Which distances (K,) are wrong, and of which (K,) of these it is sure.

    Those that are wrong together agree among each other, so the rows are asked by themselves first.
    """
    denied = foretold.denied()
    certain = denied.copy()
    kept = np.flatnonzero(~denied)
    if kept.size:
        denied[kept], sure = _contradicting(foretold.away[kept], foretold.spread[np.ix_(kept, kept)])
        certain[kept] = denied[kept] & sure
    return denied, certain


def _contradicting(away: Floats, spread: Floats) -> tuple[Bools, bool]:
    """Which distances (K,) the others and the rows deny, and whether it is sure that it is these."""
    weight: Floats = np.asarray(np.linalg.inv(spread), float)
    kept = np.ones(len(away), bool)
    if not (_times(*_off(weight, away)) > 1.0).any():
        return ~kept, True
    cures = np.array([not (_times(*_off(_without(weight, one), away)) > 1.0).any() for one in range(len(away))])
    if cures.any():
        return cures, int(np.count_nonzero(cures)) == 1
    while (times := _times(*_off(weight, away))).max() > 1.0:
        one = int(np.argmax(times))
        weight, kept[one] = _without(weight, one), False
    return ~kept, True


def _times(off: Floats, sigma: Floats) -> Floats:
    """By how many times what is let pass each is off."""
    return np.asarray(np.abs(off) / np.maximum(FAR * sigma, LEAST_MM))


def _off(weight: Floats, away: Floats) -> tuple[Floats, Floats]:
    """How far each (K,) is off, given all others, and the 1 σ of that; `weight` (K, K): inverse covariance of `away`.

    Of one that was taken out: 0 ± ∞.
    """
    own = np.diag(weight)
    there = own > 0.0
    variance = np.where(there, 1.0 / np.where(there, own, 1.0), np.inf)
    return np.where(there, weight @ away, 0.0) * np.where(there, variance, 0.0), np.sqrt(variance)


def _without(weight: Floats, one: int) -> Floats:
    """The inverse covariance without distance `one`, whose row and column are 0 from then on."""
    result = weight - np.outer(weight[one], weight[one]) / weight[one, one]
    result[one], result[:, one] = 0.0, 0.0
    return np.asarray(result)
