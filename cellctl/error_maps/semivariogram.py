"""Semivariograms: how fast measured errors become different with the distance of their postures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self, final

import numpy as np

from cellctl.kinematics import Floats

BINS = 20
"""Equal intervals between the least and the greatest distance (Meng et al. 2024, section 3.2)."""

RANGES = np.geomspace(0.05, 3.0, 60)
"""Range parameters that are tried, in greatest distances: 5 % (one interval) … 300 % (γ is a parabola over all)."""


@final
@dataclass(frozen=True, eq=False)
class EmpiricalSemivariogram:
    """γ(h) = Σ(e_i − e_j)²/(2N) of the pairs in each interval of distances; intervals without a pair are left out.

    distances (B,): middle of each interval, without a unit. gamma (B,). pairs (B,): their number. greatest: distance of
    the two postures farthest apart.
    """

    distances: Floats
    gamma: Floats
    pairs: Floats
    greatest: float

    @classmethod
    def of(cls, distances: Floats, differences: Floats, bins: int = BINS) -> Self:
        """Of pairs with these distances (P,) and differences of their errors (P,)."""
        least, greatest = float(distances.min()), float(distances.max())
        width = max(greatest - least, 1e-300) / bins
        number = np.minimum(((distances - least) / width).astype(int), bins - 1)
        pairs = np.bincount(number, minlength=bins)
        sums = np.asarray(np.bincount(number, differences**2, minlength=bins), float)
        some = pairs > 0
        middles = np.asarray(least + width * (np.arange(bins) + 0.5), float)
        gamma = sums[some] / (2.0 * pairs[some])
        return cls(middles[some], np.asarray(gamma, float), pairs[some].astype(float), greatest)


@final
@dataclass(frozen=True, slots=True)
class GaussianSemivariogram:
    """γ(h) = C_n + C_s (1 − exp(−3h²/C_r²)): nugget C_n, sill C_s, range C_r (Meng et al. 2024, eq. 14)."""

    nugget: float
    sill: float
    range: float

    @classmethod
    def fitted(cls, found: EmpiricalSemivariogram) -> Self:
        """Least squares over the intervals, C_n and C_s not negative.

        For a given range both have a closed form. The range is the best of `RANGES`, then the best of as many between
        its neighbours: within 0.3 %.
        """
        ranges = RANGES * found.greatest
        best = _best(found, ranges)[0]
        finer = np.geomspace(ranges[max(best - 1, 0)], ranges[min(best + 1, len(ranges) - 1)], len(ranges))
        place, nugget, sill = _best(found, finer)
        return cls(nugget, sill, float(finer[place]))

    def at(self, distances: Floats) -> Floats:
        """γ at `distances`, in their shape."""
        return np.asarray(self.nugget + self.sill * (1.0 - np.exp(-3.0 * distances**2 / self.range**2)))


def _best(found: EmpiricalSemivariogram, ranges: Floats) -> tuple[int, float, float]:
    """Which of the ranges (M,) leaves the least sum of squares; its nugget and sill."""
    shape = 1.0 - np.exp(-3.0 * found.distances**2 / ranges[:, None] ** 2)
    nugget, sill = _not_negative_line(shape, found.gamma)
    squares = np.sum((nugget[:, None] + sill[:, None] * shape - found.gamma) ** 2, axis=1)
    best = int(np.argmin(squares))
    return best, float(nugget[best]), float(sill[best])


def _not_negative_line(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Least squares y ≈ a + b x of each row of x (M, B), with a, b ≥ 0: a, b (M,)."""
    away = x - x.mean(axis=1, keepdims=True)
    b = np.maximum(away @ (y - y.mean()) / np.maximum(np.sum(away**2, axis=1), 1e-300), 0.0)
    a = y.mean() - b * x.mean(axis=1)
    through_zero = np.maximum(x @ y / np.maximum(np.sum(x**2, axis=1), 1e-300), 0.0)
    return np.where(a < 0.0, 0.0, a), np.where(a < 0.0, through_zero, b)
