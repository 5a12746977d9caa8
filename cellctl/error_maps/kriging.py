"""Kriging of position errors over the joints: semivariogram, and a weight for each joint by a particle filter.

Meng, Wei, Feng, Dong, Kang, Guo, Yang: A Robot Error Prediction and Compensation Method Using Joint Weights
Optimization Within Configuration Space. Appl. Sci. 2024, 14, 11682, doi 10.3390/app142411682. Equations 12–20.
The nugget is fitted and, as in the paper, not used. There is no unbiasedness constraint, whatever its title says.

The paper gives neither the number of particles nor their spread, number of rounds, threshold or the Gaussian of the
importance. The values here are ours. The test set is not the one whose errors are reported.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Self, TypeAlias, final

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.spatial.distance import cdist, pdist

from cellctl.error_maps.samples import Scale, checked
from cellctl.kinematics import Floats

BINS = 20
_LEAST_BINS = 4
RANGES = np.geomspace(0.05, 3.0, 60)
"""Ranges tried, in shares of the greatest distance: 5 % is one bin; with 300 % the model is a parabola."""

_REFINEMENTS = 2
"""As many ranges again between the neighbours of the best; after two the range is within 0.01 %."""


GAUSSIAN, EXPONENTIAL = 2.0, 1.0
"""Powers of the distance in a semivariogram. The paper's is Gaussian: errors are smooth everywhere. Exponential: they
have a kink at each sample, as where something in them changes within a few degrees."""


@final
@dataclass(frozen=True, slots=True)
class SemivariogramModel:
    """γ(h) = nugget + sill · (1 − exp(−3 (h / range)^power)); rms: of the bins about it. power: 2, Gaussian; 1,
    exponential.

    nugget is the semivariance at distance 0, nugget + sill that of unrelated points; range: the distance at which 95 %
    of the sill is reached, NaN where there is no sill.
    """

    nugget: float
    sill: float
    range: float
    rms: float
    power: float = GAUSSIAN

    def at(self, h: Floats) -> Floats:
        """γ at distances h (…)."""
        rise = self.sill * _shape(h, self.range, self.power) if self.sill > 0.0 else np.zeros(np.shape(h))
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
    model: SemivariogramModel | None


def semivariogram(
    distances: Floats, values: Floats, kept: Floats | None = None, power: float = GAUSSIAN
) -> EmpiricalSemivariogram:
    """γ(h) = Σ (e_i − e_j)² / (2 N) over the N pairs of each bin.

    distances (N(N−1)/2,): of each pair, in the order of `scipy.spatial.distance.pdist`; values (N,): one component of
    the errors. kept: mask of the pairs used; None: all. power: of the model.
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
    return EmpiricalSemivariogram(centre, gamma, pairs, fitted_model(centre, gamma, power))


def fitted_model(centre: Floats, gamma: Floats, power: float = GAUSSIAN) -> SemivariogramModel | None:
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
        best = int(np.argmin(_lines(h, found, ranges, power)[2]))
        ranges = np.geomspace(ranges[max(best - 1, 0)], ranges[min(best + 1, len(ranges) - 1)], len(ranges))
    nuggets, sills, squares = _lines(h, found, ranges, power)
    best = int(np.argmin(squares))
    length = float(ranges[best]) if sills[best] > 0.0 else float("nan")
    return SemivariogramModel(float(nuggets[best]), float(sills[best]), length, float(squares[best] ** 0.5), power)


def _lines(h: Floats, gamma: Floats, ranges: Floats, power: float) -> tuple[Floats, Floats, Floats]:
    """Nugget, sill, neither negative, and mean square left (M,), by least squares with each of the ranges (M,)."""
    shape = _shape(h, ranges[:, None], power)
    away = shape - shape.mean(axis=1, keepdims=True)
    sill = np.maximum(away @ (gamma - gamma.mean()) / np.maximum(np.sum(away**2, axis=1), 1e-300), 0.0)
    nugget = gamma.mean() - sill * shape.mean(axis=1)
    through_zero = shape @ gamma / np.maximum(np.sum(shape**2, axis=1), 1e-300)
    sill, nugget = np.where(nugget < 0.0, through_zero, sill), np.maximum(nugget, 0.0)
    return nugget, sill, np.mean((nugget[:, None] + sill[:, None] * shape - gamma) ** 2, axis=1)


def _shape(h: Floats, length: Floats | float, power: float) -> Floats:
    return np.asarray(1.0 - np.exp(-3.0 * (h / length) ** power))


REGULARISATION = 1e-3
"""λ, a share of the variance of the errors. The paper has no value. This one is noise of 3 % of their scatter: 0.03 mm
where the errors of a large arm scatter by 1 mm."""

UNRELATED = 1e-3
"""Range where the semivariogram does not rise, or has no model: each error counts at its own posture alone."""

INITIAL_WEIGHTS = np.array(
    [
        [0.5, 0.5, 1.5, 0.5, 2.0, 0.5],
        [1.5, 2.0, 0.5, 0.5, 0.5, 1.5],
        [1.5, 0.5, 2.0, 1.0, 1.5, 0.5],
    ]
)
"""W_init (3, 6): the paper's initial weights of joints 1 … 6, for the x, y and z error of its KR 300 R2500."""


@final
@dataclass(frozen=True, eq=False)
class Kriging:
    """The method. joint_weights (3, n): a weight of each joint, for the error along each axis; none given: all 1, the
    isotropic map. regularisation: λ. power: of the semivariogram.
    """

    joint_weights: Floats | None = None
    regularisation: float = REGULARISATION
    power: float = GAUSSIAN

    def fit(self, q: Floats, errors: Floats) -> KrigingMap:
        """The map of errors (N, 3), mm, actual − nominal, at model angles q (N, n), rad.

        Raises UnusableSamples (`samples.checked`), and ValueError for joint weights of another robot. A joint that
        never moved has no influence. An error that is constant is predicted as that constant.
        """
        q, errors = checked(q, errors)
        weights = np.ones((3, q.shape[1])) if self.joint_weights is None else np.asarray(self.joint_weights, float)
        if weights.shape != (3, q.shape[1]):
            raise ValueError(f"joint weights {weights.shape} for {q.shape[1]} joints: give (3, {q.shape[1]})")
        joints, scale = Scale.of(q), Scale.of(errors)
        standard, of_errors = joints.standardised(q), scale.standardised(errors)
        axes = [
            AxisMap.of(standard * own, error, self.regularisation, self.power)
            for own, error in zip(weights, of_errors.T, strict=True)
        ]
        return KrigingMap(joints, scale, weights, (axes[0], axes[1], axes[2]))


@final
@dataclass(frozen=True, eq=False)
class AxisMap:
    """The map of one standardised component. points (N, n): weighted standardised angles; semivariogram of their
    errors, None in a map that was stored; range: C_r, of its model; regularisation: λ; power: of the
    distance; pull (N,): (C + λI)⁻¹ e.
    """

    points: Floats
    semivariogram: EmpiricalSemivariogram | None
    range: float
    regularisation: float
    power: float
    pull: Floats = field(repr=False)

    @classmethod
    def of(cls, points: Floats, error: Floats, regularisation: float, power: float = GAUSSIAN) -> Self:
        """From weighted standardised angles (N, n) and standardised errors (N,)."""
        found = semivariogram(pdist(points), error, power=power)
        reach = found.model.range if found.model and found.model.sill > 0.0 else UNRELATED
        root = _root(points, reach, regularisation, power)
        return cls(points, found, reach, regularisation, power, cho_solve((root, True), error))

    def predicted(self, points: Floats) -> Floats:
        """wᵀe (M,) with w = (C + λI)⁻¹ c at weighted standardised angles (M, n)."""
        return np.asarray(_covariance(points, self.points, self.range, self.power) @ self.pull)

    def variance(self, points: Floats) -> Floats:
        """1 − cᵀ(C + λI)⁻¹c (M,) of `predicted`, in units of the errors' variance: about λ at a sample, 1 far away.

        Of simple kriging (mean known, 0 after standardising): Rasmussen and Williams 2006, equation 2.26.
        """
        covariance = _covariance(points, self.points, self.range, self.power)
        known = solve_triangular(self._root, covariance.T, lower=True, check_finite=False)
        return np.asarray(np.maximum(1.0 - np.sum(known**2, axis=0), 0.0))

    @cached_property
    def _root(self) -> Floats:
        return _root(self.points, self.range, self.regularisation, self.power)


@final
@dataclass(frozen=True, eq=False)
class KrigingMap:
    """A fitted map (`ErrorMap`). joints, scale: of angles, rad, and errors, mm; joint_weights (3, n); axes: x, y, z."""

    joints: Scale
    scale: Scale
    joint_weights: Floats
    axes: tuple[AxisMap, AxisMap, AxisMap]

    def errors(self, q: Floats) -> Floats:
        """Error of the TCP (N, 3), mm, actual − nominal, at model angles q (N, n), rad: μ + σ wᵀe of each component."""
        standard = self.joints.standardised(np.asarray(q, float))
        own = [axis.predicted(standard * weights) for axis, weights in zip(self.axes, self.joint_weights, strict=True)]
        return self.scale.restored(np.stack(own, axis=-1))

    def variance(self, q: Floats) -> Floats:
        """Kriging variance (N, 3), mm², of `errors` at model angles q (N, n), rad, before any calibration."""
        standard = self.joints.standardised(np.asarray(q, float))
        own = [axis.variance(standard * weights) for axis, weights in zip(self.axes, self.joint_weights, strict=True)]
        return np.asarray(self.scale.deviation**2 * np.stack(own, axis=-1))


def _root(points: Floats, reach: float, regularisation: float, power: float) -> Floats:
    """Lower Cholesky factor (N, N) of C + λI."""
    return np.asarray(
        cholesky(_covariance(points, points, reach, power) + regularisation * np.eye(len(points)), lower=True)
    )


def _covariance(a: Floats, b: Floats, reach: float, power: float) -> Floats:
    """C (A, B) = exp(−3 (‖a − b‖/C_r)^power): σ² is 1 after standardising."""
    squares = cdist(a, b, "sqeuclidean") / reach**2
    return np.asarray(np.exp(-3.0 * (squares if power == GAUSSIAN else squares ** (0.5 * power))))


Error: TypeAlias = Callable[[Floats], float]
"""Mean error on the test set, mm, with joint weights (n,)."""

LEAST_WEIGHT = 0.02
"""A weight is positive: at 0 the joint has no influence, and a negative one is its mirror image."""


@final
@dataclass(frozen=True, eq=False)
class ParticleFilter:
    """Search for joint weights.

    initial (3, n): W_init, mean of the first particles for each axis. particles: N. spread: σ_init. rounds: T.
    threshold_mm: the search of an axis ends where the mean error of its particles is below this. fresh: share of the
    particles that are drawn anew from the first distribution in each round. narrowing: factor on the spread of
    resampled particles from round to round. seed: of the random numbers; the same seed gives the same weights.
    """

    initial: Floats
    particles: int = 60
    spread: float = 0.3
    rounds: int = 15
    threshold_mm: float = 0.01
    fresh: float = 0.1
    narrowing: float = 0.85
    seed: int = 0

    @classmethod
    def published(cls) -> ParticleFilter:
        """From the paper's W_init, for six joints."""
        return cls(INITIAL_WEIGHTS)

    def weights(
        self,
        q: Floats,
        errors: Floats,
        q_test: Floats,
        errors_test: Floats,
        regularisation: float = REGULARISATION,
        power: float = GAUSSIAN,
    ) -> Floats:
        """The weights (3, n) with the least mean error on the test set, for `Kriging(weights)`.

        q (N, n), rad, errors (N, 3), mm: rows of the map. q_test (M, n), errors_test (M, 3): rows of the test set.
        Raises as `Kriging.fit` does, also for rows of the test set.
        """
        q, errors = checked(q, errors)
        q_test, errors_test = checked(q_test, errors_test)
        if self.initial.shape != (3, q.shape[1]) or q_test.shape[1] != q.shape[1]:
            raise ValueError(f"initial weights {self.initial.shape} and rows of {q.shape[1]} joints do not match")
        joints, scale = Scale.of(q), Scale.of(errors)
        own, test = joints.standardised(q), joints.standardised(q_test)
        of_own, of_test = scale.standardised(errors), scale.standardised(errors_test)
        found = []
        for axis in range(3):
            rng = np.random.default_rng([self.seed, axis])

            def error(weights: Floats, axis: int = axis) -> float:
                made = AxisMap.of(own * weights, of_own[:, axis], regularisation, power)
                away = made.predicted(test * weights) - of_test[:, axis]
                return float(scale.deviation[axis] * np.mean(np.abs(away)))

            found.append(self._best(error, self.initial[axis], rng))
        return np.array(found)

    def _best(self, error: Error, initial: Floats, rng: np.random.Generator) -> Floats:
        """The weights (n,) with the least error of all particles of all rounds; W_init is one of the first."""
        particles = np.vstack([initial, self._first(initial, self.particles - 1, rng)])
        best, least, spread = initial, np.inf, self.spread
        for _ in range(self.rounds):
            errors = np.array([error(each) for each in particles])
            if errors.min() < least:
                best, least = particles[int(np.argmin(errors))], float(errors.min())
            if errors.mean() < self.threshold_mm:
                break
            spread *= self.narrowing
            particles = self._resampled(particles, errors, initial, spread, rng)
        return best

    def _first(self, initial: Floats, count: int, rng: np.random.Generator) -> Floats:
        return _positive(initial + self.spread * rng.standard_normal((count, len(initial))))

    def _resampled(
        self, particles: Floats, errors: Floats, initial: Floats, spread: float, rng: np.random.Generator
    ) -> Floats:
        """Particles in proportion to their importance, each moved a little, and fresh ones. The importance is a
        Gaussian of the error, whose standard deviation is half the least error of the round.
        """
        fresh = round(self.fresh * len(particles))
        scaled = errors / max(0.5 * float(errors.min()), 1e-12)
        importance = np.exp(-0.5 * (scaled**2 - float(scaled.min()) ** 2))
        chosen = rng.choice(len(particles), len(particles) - fresh, p=importance / importance.sum())
        moved = particles[chosen] + spread * rng.standard_normal((len(chosen), particles.shape[1]))
        return np.vstack([_positive(moved), self._first(initial, fresh, rng)])


def _positive(weights: Floats) -> Floats:
    return np.maximum(np.abs(weights), LEAST_WEIGHT)
