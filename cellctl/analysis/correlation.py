"""Correlation of the distance between two errors with the distance between their postures, and its Mantel test.

N rows make N(N−1)/2 pairs, but they are not independent: each row is in N−1 of them. The usual p-value of Pearson's
correlation takes them as independent and is far too small. Mantel's test (Mantel 1967, Cancer Research 27) permutes
the rows instead.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import numpy as np
from scipy.spatial.distance import pdist, squareform
from scipy.special import betainc

from cellctl.kinematics import Floats


@final
@dataclass(frozen=True, slots=True)
class Correlation:
    """Pearson's r over all pairs; p: Mantel test, two-sided; p_if_independent: what a t test of r states, as published
    tables do. permutations, pairs: their numbers. 95 % of the permuted correlations lie in low_95…high_95.
    """

    r: float
    p: float
    p_if_independent: float
    permutations: int
    pairs: int
    low_95: float
    high_95: float


def mantel(
    errors: Floats, spaces: Mapping[str, Floats], permutations: int, rng: np.random.Generator
) -> dict[str, Correlation]:
    """Correlation of the distances between `errors` (N, k) with those between the points (N, m) of each of `spaces`.

    Two-sided: p = (1 + number of permutations with |r| at least as large) / (1 + permutations). All spaces have the
    same permutations. A space or errors without any distance has no correlation: NaN, p 1.
    """
    count = len(errors)
    apart = _centred(pdist(errors))
    others = np.array([_centred(pdist(points)) for points in spaces.values()])
    found = others @ apart
    square = squareform(apart)
    first, second = np.triu_indices(count, 1)
    permuted = np.empty((permutations, len(others)))
    for place in range(permutations):
        order = rng.permutation(count)
        permuted[place] = others @ square[order[first], order[second]]
    judged = [_judged(float(r), permuted[:, column], len(apart)) for column, r in enumerate(found)]
    return dict(zip(spaces, judged, strict=True))


def _judged(r: float, permuted: Floats, pairs: int) -> Correlation:
    if not np.isfinite(r):
        return Correlation(float("nan"), 1.0, 1.0, len(permuted), pairs, float("nan"), float("nan"))
    as_large = int(np.count_nonzero(np.abs(permuted) >= abs(r) - 1e-12))
    low, high = np.quantile(permuted, [0.025, 0.975]).tolist() if len(permuted) else (float("nan"),) * 2
    p = (1.0 + as_large) / (1.0 + len(permuted))
    return Correlation(r, p, _p_if_independent(r, pairs), len(permuted), pairs, low, high)


def _centred(distances: Floats) -> Floats:
    """Distances less their mean, of length 1, so that a scalar product is a correlation; NaN if all are equal."""
    away = distances - distances.mean()
    size = float(np.linalg.norm(away))
    return np.asarray(away / size) if size > 1e-9 * max(float(np.abs(distances).max()), 1e-300) else away * np.nan


def _p_if_independent(r: float, pairs: int) -> float:
    """Two-sided p-value of r among `pairs` independent pairs: Student's t with pairs − 2 degrees of freedom."""
    free = pairs - 2
    return float(betainc(free / 2.0, 0.5, max(0.0, 1.0 - r * r)))
