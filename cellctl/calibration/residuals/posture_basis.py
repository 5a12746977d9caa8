"""The basis of a smooth random function of the joints, made from postures, and its remaining variance at others."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import final

import numpy as np
from scipy.linalg import solve_triangular
from scipy.spatial.distance import cdist

from cellctl.calibration.selection.folds import random_folds
from cellctl.kinematics import Floats

LENGTHS_RAD = (1.0, 1.5, 2.0, 3.0, 4.5, 6.0)
"""Postures this far apart (root of the summed squares over the joints) share 60 % of the function: remainders of weight
and geometry change over some tens of degrees. Longer where the postures are too sparse for that.
"""

LEFT = 0.1
"""Half of the postures leave at most this share of the variance at the others, on average; else the length is too
short."""

MOST_AMONG = 0.4
"""`left_among` of postures that are so few that they hardly show which others are among them."""

CENTRES = 64
MOST = 1000
ALIKE_RAD = 0.05
_JITTER = 1e-6


@final
@dataclass(frozen=True, eq=False)
class PostureBasis:
    """A squared exponential Gaussian process of the joint angles, expanded at some postures (Nyström).

    centres (M, n): these postures, rad. length_rad: distance at which two postures share 60 % of the function. Raises
    ValueError for a length that is not above 0.
    """

    centres: Floats
    length_rad: float = LENGTHS_RAD[0]
    _root: Floats = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if self.length_rad <= 0.0:
            raise ValueError("the length of a discrepancy is above 0")
        square = self._kernel(self.centres) + _JITTER * np.eye(len(self.centres))
        object.__setattr__(self, "_root", np.linalg.cholesky(square))

    @classmethod
    def over(cls, q: Floats) -> PostureBasis:
        """Expanded at up to `CENTRES` of the postures q (N, n), rad. The last few results are cached."""
        angles = np.ascontiguousarray(q, float)
        return _over(angles.tobytes(), angles.shape[1])

    def joined(self, q: Floats) -> tuple[PostureBasis, float]:
        """From its own centres and postures q (N, n), rad; and `left_among` all of these."""
        both = np.vstack([q, self.centres])
        return self.over(both), left_among(both)

    def values(self, q: Floats) -> Floats:
        """The functions φ (N, M) at q (N, n), rad: of unit variance where their squares sum to 1."""
        return np.asarray(solve_triangular(self._root, self._kernel(q).T, lower=True, check_finite=False).T)

    def kernel_weights(self, amounts: Floats) -> Floats:
        """Weights (M, …) of the kernel at each centre, for amounts (M, …) of the functions φ: k(q)·w = φ(q)·κ."""
        return np.asarray(solve_triangular(self._root.T, amounts, lower=False, check_finite=False))

    def remainder(self, q: Floats) -> Floats:
        """The share (N,) of the variance at q (N, n), rad, that the centres leave: 0 at them, 1 far away."""
        return np.asarray(np.clip(1.0 - np.sum(self.values(q) ** 2, axis=1), 0.0, 1.0))

    def _kernel(self, q: Floats) -> Floats:
        return np.asarray(np.exp(-0.5 * cdist(q, self.centres, "sqeuclidean") / self.length_rad**2))


def left_among(q: Floats) -> float:
    """The share of variance that postures q (N, n), rad, leave at one of them that is left out: 95 % have less.

    A posture with no more than this is among them; the noise of their rows has its error already.
    """
    folds = random_folds(q)
    if len(folds) < 2:
        return 0.0
    left = [PostureBasis.over(np.delete(q, fold, axis=0)).remainder(q[fold]) for fold in folds]
    return float(min(np.quantile(np.concatenate(left), 0.95), MOST_AMONG))


@lru_cache(maxsize=8)
def _over(content: bytes, joints: int) -> PostureBasis:
    q = np.frombuffer(content).reshape(-1, joints)
    some = q[np.random.default_rng(len(q)).permutation(len(q))[:MOST]]
    half, others = some[::2], some[1::2]
    for length in LENGTHS_RAD[:-1]:
        if not len(others) or PostureBasis(spread(half), length).remainder(others).mean() <= LEFT:
            return PostureBasis(spread(q), length)
    return PostureBasis(spread(q), LENGTHS_RAD[-1])


def spread(q: Floats, most: int = CENTRES) -> Floats:
    """At most `most` of the postures q (N, n), each the farthest from those before; no two alike."""
    chosen = [int(np.argmin(np.linalg.norm(q - q.mean(axis=0), axis=1)))]
    distance = np.linalg.norm(q - q[chosen[0]], axis=1)
    while len(chosen) < most and distance.max() > ALIKE_RAD:
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.linalg.norm(q - q[chosen[-1]], axis=1))
    return q[chosen]
