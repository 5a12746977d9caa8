"""Empirical semivariograms, and the Gaussian model fitted to them (Meng et al. 2024, section 3.2, eq. 12-14)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from scipy.spatial.distance import pdist

from cellctl.kinematics import Floats

BINS = 20
_LEAST_BINS = 4
RANGES = np.geomspace(0.05, 3.0, 60)
"""Ranges tried, in shares of the greatest distance: 5 % is one bin; with 300 % the model is a parabola."""

_REFINEMENTS = 2
"""As many ranges again between the neighbours of the best; after two the range is within 0.01 %."""


@final
@dataclass(frozen=True, slots=True)
class GaussianSemivariogram:
    """γ(h) = nugget + sill · (1 − exp(−3 h² / range²)); rms: of the bins about it.

    nugget is the semivariance at distance 0, nugget + sill that of unrelated points; range: the distance at which 95 %
    of the sill is reached, NaN where there is no sill.
    """

    nugget: float
    sill: float
    range: float
    rms: float

    def at(self, h: Floats) -> Floats:
        """γ at distances h (…)."""
        rise = self.sill * _shape(h, self.range) if self.sill > 0.0 else np.zeros(np.shape(h))
        return np.asarray(self.nugget + rise)


@final
@dataclass(frozen=True, slots=True, eq=False)
class EmpiricalSemivariogram:
    """20 equal bins from the least to the greatest distance. centre (20,): middle of each; gamma (20,): semivariance,
    NaN in an empty bin; pairs (20,): count. model: None with fewer than four bins that have pairs.
    """

    centre: Floats
    gamma: Floats
    pairs: Floats
    model: GaussianSemivariogram | None


def semivariogram(distances: Floats, values: Floats, kept: Floats | None = None) -> EmpiricalSemivariogram:
    """γ(h) = Σ (e_i − e_j)² / (2 N) over the N pairs of each bin.

    distances (N(N−1)/2,): of each pair, in the order of `scipy.spatial.distance.pdist`; values (N,): one component of
    the errors. kept: mask of the pairs used; None: all.
    """
    squares = pdist(values[:, None], "sqeuclidean") / 2.0
    if kept is not None:
        distances, squares = distances[kept], squares[kept]
    low, high = float(distances.min(initial=np.inf)), float(distances.max(initial=-np.inf))
    if not high > low:
        empty = np.full(BINS, np.nan)
        return EmpiricalSemivariogram(empty, empty, np.zeros(BINS), None)
    which = np.minimum(((distances - low) / (high - low) * BINS).astype(int), BINS - 1)
    pairs = np.bincount(which, minlength=BINS).astype(float)
    total = np.bincount(which, squares, BINS)
    gamma = np.divide(total, pairs, out=np.full(BINS, np.nan), where=pairs > 0)
    centre = low + (np.arange(BINS) + 0.5) * (high - low) / BINS
    return EmpiricalSemivariogram(centre, gamma, pairs, fit_gaussian(centre, gamma))


def fit_gaussian(centre: Floats, gamma: Floats) -> GaussianSemivariogram | None:
    """Least squares over those of equal bins that have pairs, all with one weight; nugget and sill are not negative.

    For a given range both have a closed form. So only the range is searched: over `RANGES`, then about the best. None
    with fewer than four bins that have pairs.
    """
    there = np.isfinite(gamma)
    if np.count_nonzero(there) < _LEAST_BINS:
        return None
    h, found = centre[there], gamma[there]
    greatest = centre[-1] + 0.5 * (centre[-1] - centre[-2])
    ranges = RANGES * float(greatest)
    for _ in range(_REFINEMENTS):
        best = int(np.argmin(_lines(h, found, ranges)[2]))
        ranges = np.geomspace(ranges[max(best - 1, 0)], ranges[min(best + 1, len(ranges) - 1)], len(ranges))
    nuggets, sills, squares = _lines(h, found, ranges)
    best = int(np.argmin(squares))
    length = float(ranges[best]) if sills[best] > 0.0 else float("nan")
    return GaussianSemivariogram(float(nuggets[best]), float(sills[best]), length, float(squares[best] ** 0.5))


def _lines(h: Floats, gamma: Floats, ranges: Floats) -> tuple[Floats, Floats, Floats]:
    """Nugget, sill, neither negative, and mean square left (M,), by least squares with each of the ranges (M,)."""
    shape = _shape(h, ranges[:, None])
    away = shape - shape.mean(axis=1, keepdims=True)
    sill = np.maximum(away @ (gamma - gamma.mean()) / np.maximum(np.sum(away**2, axis=1), 1e-300), 0.0)
    nugget = gamma.mean() - sill * shape.mean(axis=1)
    through_zero = shape @ gamma / np.maximum(np.sum(shape**2, axis=1), 1e-300)
    sill, nugget = np.where(nugget < 0.0, through_zero, sill), np.maximum(nugget, 0.0)
    return nugget, sill, np.mean((nugget[:, None] + sill[:, None] * shape - gamma) ** 2, axis=1)


def _shape(h: Floats, length: Floats | float) -> Floats:
    return np.asarray(1.0 - np.exp(-3.0 * (h / length) ** 2))
