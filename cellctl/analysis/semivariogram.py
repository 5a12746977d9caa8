"""Empirical semivariograms, and the Gaussian model fitted to them (KRG eq. 12-14)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.spatial.distance import pdist

from cellctl.kinematics import Floats

BINS = 20
_LEAST_BINS = 4
_RANGES = np.geomspace(0.1, 2.0, 60)
"""Ranges tried, in shares of the greatest distance: a shorter one is a nugget, a longer one a parabola."""


@final
@dataclass(frozen=True, slots=True)
class GaussianModel:
    """γ(h) = nugget + sill · (1 − exp(−3 h² / range²)); rms: of the bins about it, weighted by their pairs.

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
class Semivariogram:
    """20 equal bins from the least to the greatest distance. centre (20,): middle of each; gamma (20,): semivariance,
    NaN in an empty bin; pairs (20,): count. model: None with fewer than four bins that have pairs.
    """

    centre: Floats
    gamma: Floats
    pairs: Floats
    model: GaussianModel | None


def semivariogram(distances: Floats, values: Floats, kept: Floats | None = None) -> Semivariogram:
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
        return Semivariogram(empty, empty, np.zeros(BINS), None)
    which = np.minimum(((distances - low) / (high - low) * BINS).astype(int), BINS - 1)
    pairs = np.bincount(which, minlength=BINS).astype(float)
    total = np.bincount(which, squares, BINS)
    gamma = np.divide(total, pairs, out=np.full(BINS, np.nan), where=pairs > 0)
    centre = low + (np.arange(BINS) + 0.5) * (high - low) / BINS
    return Semivariogram(centre, gamma, pairs, fit_gaussian(centre, gamma, pairs))


def fit_gaussian(centre: Floats, gamma: Floats, pairs: Floats) -> GaussianModel | None:
    """The Gaussian model nearest to the bins, weighted by their pairs; nugget and sill are not negative.

    For a given range the model is linear in nugget and sill. So only the range is searched: over a grid, then about
    its best value. None with fewer than four bins that have pairs.
    """
    there = pairs > 0
    if np.count_nonzero(there) < _LEAST_BINS:
        return None
    h, found, weight = centre[there], gamma[there], pairs[there] / pairs[there].sum()
    ranges = _RANGES * h.max()
    costs = [_linear(h, found, weight, each)[2] for each in ranges]
    best = int(np.argmin(costs))
    ends = (float(ranges[max(best - 1, 0)]), float(ranges[min(best + 1, len(ranges) - 1)]))
    refined = minimize_scalar(lambda each: _linear(h, found, weight, each)[2], bounds=ends, method="bounded")
    length = float(refined.x) if refined.fun <= costs[best] else float(ranges[best])
    nugget, sill, cost = _linear(h, found, weight, length)
    return GaussianModel(nugget, sill, length if sill > 0.0 else float("nan"), cost**0.5)


def _linear(h: Floats, gamma: Floats, weight: Floats, length: float) -> tuple[float, float, float]:
    """Nugget and sill of the weighted least squares, neither negative, and the weighted mean square left."""
    shape = _shape(h, length)
    mean, mean_shape = float(weight @ gamma), float(weight @ shape)
    spread = float(weight @ (shape - mean_shape) ** 2)
    slope = float(weight @ ((shape - mean_shape) * (gamma - mean))) / spread if spread > 1e-15 else 0.0
    trials = [(mean - slope * mean_shape, slope), (mean, 0.0)]
    square = float(weight @ shape**2)
    if square > 0.0:
        trials.append((0.0, float(weight @ (shape * gamma)) / square))
    costs = [
        (float(weight @ (nugget + sill * shape - gamma) ** 2), nugget, sill)
        for nugget, sill in trials
        if nugget >= 0.0 and sill >= 0.0
    ]
    cost, nugget, sill = min(costs)
    return nugget, sill, cost


def _shape(h: Floats, length: float) -> Floats:
    return np.asarray(1.0 - np.exp(-3.0 * (h / length) ** 2))
