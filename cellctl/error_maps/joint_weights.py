"""Joint weights of kriging by a particle filter on a test set (Meng et al. 2024, section 3.2, figure 11).

The paper gives neither the number of particles nor their spread, number of rounds, threshold or the Gaussian of the
importance. The values here are ours. The test set is not the one whose errors are reported.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias, final

import numpy as np

from cellctl.error_maps.kriging import INITIAL_WEIGHTS, REGULARISATION, AxisMap
from cellctl.error_maps.samples import Scale, checked
from cellctl.kinematics import Floats

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
        self, q: Floats, errors: Floats, q_test: Floats, errors_test: Floats, regularisation: float = REGULARISATION
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
                made = AxisMap.of(own * weights, of_own[:, axis], regularisation)
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
