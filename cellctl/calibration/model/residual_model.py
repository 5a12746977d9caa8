"""The interface of a residual model beyond that of an effect, and a basis of smooth functions made from postures.

A Gaussian process with kernel k(q, q') = exp(−‖q − q'‖²/2ℓ²) has one unknown for each row. It is expanded at M centres
C (Nyström; Rasmussen and Williams 2006, section 8.1): with L Lᵀ = k(C, C) and φ(q) = L⁻¹ k(C, q),

    δ(q) = Σ_m φ_m(q) κ_m,    κ ~ N(0, s²)    ⇒    cov δ(q), δ(q') = s² φ(q)·φ(q') = s² k(q, C) k(C, C)⁻¹ k(C, q'),

linear in M amounts, so that the estimator treats it as any effect. At the centres it is the process; elsewhere the
share 1 − ‖φ(q)‖² of the variance is missing (`remainder`), which the region of the rows, or the model itself, adds to
σ.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import ClassVar, Self, final

import numpy as np
from scipy.linalg import solve_triangular

from cellctl.calibration.folds import random_folds
from cellctl.calibration.model.effect import Effect
from cellctl.calibration.model.postures import Postures
from cellctl.kinematics import Floats, SerialChain

LENGTHS_RAD = (1.0, 1.5, 2.0, 3.0, 4.5, 6.0)
"""ℓ. Values of δ at postures this far apart (root of the summed squares over the joints) have the correlation
exp(−½) = 0.61: remainders of weight and geometry change over some tens of degrees. Longer where the postures are too
sparse for that.
"""

REMAINDER_AT_MOST = 0.1
"""Half of the postures leave at most this share of the variance at the others, on average; else ℓ is too short: δ would
be noise at each posture, and say nothing between them. The rows' errors take no part in the choice of ℓ: a length from
the marginal likelihood is `JointField`'s."""

LEFT_AMONG_AT_MOST = 0.4
"""`left_among` at most, below `measured_region.OUTSIDE` (0.5): postures that are so few that each leaves more at the
next would otherwise count everything as among them."""

CENTRES = 64
"""At most so many: a fit has three unknowns for each (x, y, z), and its time grows with their cube."""

POSTURES_AT_MOST = 1000
"""Postures that choose the length, at most. Their errors take no part in it."""

ALIKE_RAD = 0.05
"""Centres are further apart than this: nearer ones make k(C, C) singular."""

_JITTER = 1e-6
"""Share of the variance on the diagonal of k(C, C): centres 0.05 rad apart are nearly dependent; Cholesky needs it. So
the remainder at a centre is 1e-6, not 0."""


@final
@dataclass(frozen=True, eq=False)
class PostureBasis:
    """A squared exponential Gaussian process of the joint angles, expanded at some postures (Nyström).

    centres (M, n): these postures, rad. length_rad: ℓ, the distance of correlation 0.61. Raises ValueError for a length
    that is not above 0.
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
        from scipy.spatial.distance import cdist  # at first use: it takes 0.2 s

        return np.asarray(np.exp(-0.5 * cdist(q, self.centres, "sqeuclidean") / self.length_rad**2))


def left_among(q: Floats) -> float:
    """The share of variance that postures q (N, n), rad, leave at one of them that is left out: 95 % have less.

    A posture with no more than this is among them; the noise of their rows has its error already. Left out are the
    random folds of `random_folds`, a fifth at a time: the share is that of 0.8 N postures, slightly too large.
    """
    folds = random_folds(q)
    if len(folds) < 2:
        return 0.0
    left = [PostureBasis.over(np.delete(q, fold, axis=0)).remainder(q[fold]) for fold in folds]
    return float(min(np.quantile(np.concatenate(left), 0.95), LEFT_AMONG_AT_MOST))


@lru_cache(maxsize=8)
def _over(content: bytes, joints: int) -> PostureBasis:
    q = np.frombuffer(content).reshape(-1, joints)
    some = q[np.random.default_rng(len(q)).permutation(len(q))[:POSTURES_AT_MOST]]
    half, others = some[::2], some[1::2]
    for length in LENGTHS_RAD[:-1]:
        if not len(others) or PostureBasis(spread(half), length).remainder(others).mean() <= REMAINDER_AT_MOST:
            return PostureBasis(spread(q), length)
    return PostureBasis(spread(q), LENGTHS_RAD[-1])


def spread(q: Floats, most: int = CENTRES) -> Floats:
    """At most `most` of the postures q (N, n), each the farthest from those before; no two alike.

    From the most central one on (Kennard and Stone 1969, Computer aided design of experiments): the set covers the
    postures within twice the best possible distance (Gonzalez 1985).
    """
    chosen = [int(np.argmin(np.linalg.norm(q - q.mean(axis=0), axis=1)))]
    distance = np.linalg.norm(q - q[chosen[0]], axis=1)
    while len(chosen) < most and distance.max() > ALIKE_RAD:
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.linalg.norm(q - q[chosen[-1]], axis=1))
    return q[chosen]


@final
@dataclass(frozen=True, eq=False)
class Remainder:
    """What the other terms of a model leave: q (N, n), rad; errors (N, 3), mm, of the TCP along the axes of the base;
    known (3, N, N), mm²: covariance of the part of each axis' errors that the other terms may still explain.
    """

    q: Floats
    errors: Floats
    known: Floats


class ResidualModel(Effect):
    """A random function of the posture, as a sum of given functions: its amounts are their coefficients.

    It is estimated together with everything else of a model (decision 28): `of_inputs` chooses the functions, the
    estimator fits the amounts, `turns` and `shifts` apply them. Single amounts have no meaning: they are left out of
    lists of parameters, and of the search for outliers.

    The part that the given functions do not span is counted once: either by the measured region, whose postures are
    those of the rows (`far_sigma`), or by the model's own region (`variance`, `outside`).
    """

    __slots__ = ()

    is_map: ClassVar[bool] = False
    """Whether it is learnt from what all other terms leave, after them (`LearntMap`)."""

    def variance(self, nominal: SerialChain, at: Postures) -> Floats:
        """Variance of the function that the amounts leave open at each posture (N,): mm² of the TCP on each axis. Every
        σ of a prediction includes it. NaN: it is not known, and no σ is stated.
        """
        return np.zeros(len(at))

    def outside(self, at: Postures) -> Floats:
        """How far each posture (N,) is outside this model's region: 0 to 1, a share of variance. The
        measured region ends where this is large."""
        return np.zeros(len(at))

    def far_sigma(self, sigma: Floats) -> float:
        """1 σ on each axis, mm, of the function where nothing was measured, with the prior 1 σ (K,) of its amounts. The
        measured region adds the share of it that its own postures leave."""
        return 0.0

    def fitted_to(self, left: Remainder) -> Self | None:
        """The same with its settings (lengths, weights) chosen for these rows; None where they do not support it."""
        return self

    def reduced(self, bands: Collection[str]) -> Self:
        """The same without the amounts whose band (`Parameter.band`) is not among `bands`."""
        return self

    def fewer_bands(self) -> Sequence[frozenset[str]]:
        """Sets of bands to leave out, one at a time, where the whole model fails at the ends of the joint ranges."""
        return ()
