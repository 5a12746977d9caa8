"""Mean and spread of parameters over robots of one type, each of which its own rows determine only partly.

**Model.** Parameters u_r (P) of robot r, in prior standard deviations (tolerances), are drawn from N(μ, Σ). The rows of
robot r are known by their information Λ_r and the gradient η_r: ln p(rows | u) = −½ uᵀΛ_r u + η_rᵀu. Both are what a
posterior holds besides its own prior N(0, I): Λ_r = C_r⁻¹ − I, η_r = C_r⁻¹ m_r. So what no row determined, where a
posterior repeats its prior, has no weight.

**Estimate.** Restricted maximum likelihood by EM (Laird and Ware 1982, Random-effects models for longitudinal data, doi
10.2307/2529876): with V_r = (Λ_r + Σ⁻¹)⁻¹, â_r = V_r (η_r + Σ⁻¹μ), and M the covariance of μ,

    S = Σ_r (V_r + A_r M A_rᵀ + (â_r − μ)(â_r − μ)ᵀ) / R,   A_r = V_r Σ⁻¹ − I,

and Σ = D + L Lᵀ is the factor model nearest to S (Jöreskog 1967). μ ~ N(0, I), and each variance of D has an inverse
gamma prior that weighs as much as `BELIEVED` robots with the spread of the tolerance: few robots, or rows that hardly
show a parameter, leave it there. A common factor (column of L) is added while ln p of all rows grows by more than half
a BIC penalty of its P numbers.

**Prediction.** A further robot of the type is Student t about μ, with the covariance (Σ + M) ν/(ν − 2), ν = R +
`BELIEVED` − 1 degrees of freedom: heavy tails from few robots.

**Support.** If ln p of all rows does not exceed that of N(0, I) by half the BIC penalty of P means and P variances, the
robots have nothing in common, and N(0, I) is the answer: with twenty robots, some spreads are small by chance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self, final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

BELIEVED = 1.0
"""Robots that the belief counts as, that a type spreads as far as the tolerance. With less than one, a parameter that
five robots share by chance becomes certain; with more, twenty robots cannot show a spread below a third."""

ROBOTS_AT_LEAST = 3
"""With two robots the t distribution of a third has no variance (ν = 2)."""

FACTORS_AT_MOST = 3
"""Common factors cost P numbers each; beyond three, twenty robots never support one."""

STEPS, SETTLED = 400, 1e-4
"""EM ends when ln p of all rows grows by less than this, nats, or after so many steps."""

SMALLEST = 1e-4
"""Least variance of D, in tolerances²: a spread of a hundredth of the tolerance is none."""


@final
@dataclass(frozen=True, eq=False)
class RandomEffects:
    """mean (P,) and spread Σ (P, P) of a type, covariance M (P, P) of the mean; all in tolerances. gain: of ln p of all
    rows over N(0, I), nats. factors: columns of L. robots: R.
    """

    mean: Floats
    spread: Floats
    of_mean: Floats
    gain: float
    factors: int
    robots: int

    @property
    def degrees_of_freedom(self) -> float:
        """ν of the t distribution of a further robot."""
        return self.robots + BELIEVED - 1.0

    @property
    def predicted(self) -> Floats:
        """Covariance (P, P) of a further robot's parameters about the mean."""
        return (self.spread + self.of_mean) * self.degrees_of_freedom / (self.degrees_of_freedom - 2.0)

    @property
    def supported(self) -> bool:
        """Whether the rows show that the robots have something in common."""
        return self.gain > len(self.mean) * float(np.log(self.robots))

    @classmethod
    def of(cls, information: Floats, gradient: Floats) -> Self:
        """Of R robots with Λ (R, P, P) and η (R, P). Raises ValueError for fewer than three."""
        robots, count = gradient.shape
        if robots < ROBOTS_AT_LEAST:
            raise ValueError(f"{robots} robots have no spread to speak of: {ROBOTS_AT_LEAST} are needed")
        none = _log_likelihood(information, gradient, np.zeros(count), np.eye(count))
        best, kept = _em(information, gradient, 0, np.eye(count)), 0
        for factors in range(1, min(FACTORS_AT_MOST, count - 1) + 1):
            wider = _em(information, gradient, factors, best[1])
            if wider[3] - best[3] < 0.5 * count * float(np.log(robots)):
                break
            best, kept = wider, factors
        found = cls(*best[:3], best[3] - none, kept, robots)
        if found.supported:
            return found
        return replace(found, mean=np.zeros(count), spread=np.eye(count), of_mean=np.zeros((count, count)), factors=0)


def of_rows_alone(values: Floats, covariance: Floats, prior_sigma: Floats, tolerances: Floats) -> tuple[Floats, Floats]:
    """Λ (P, P) and η (P,), in tolerances, of a posterior: its values (P,) about 0, its covariance (P, P), and its own
    prior 1 σ (P,), 0 for a parameter that it does not have.
    """
    there = (prior_sigma > 0.0) & (np.diag(covariance) > 0.0)
    scale = prior_sigma[there]
    inverse = np.linalg.inv(covariance[np.ix_(there, there)] / np.outer(scale, scale))
    # the eigenvectors of Λ and of C⁻¹ = Λ + I are the same; rounding may leave an eigenvalue of Λ below 0
    eigenvalues, vectors = np.linalg.eigh(0.5 * (inverse + inverse.T))
    known = np.maximum(eigenvalues - 1.0, 0.0)
    own = (vectors * known) @ vectors.T
    pull = vectors @ (np.where(known > 0.0, eigenvalues, 0.0) * (vectors.T @ (values[there] / scale)))
    result, gradient = np.zeros((len(values),) * 2), np.zeros(len(values))
    units = tolerances[there] / scale
    result[np.ix_(there, there)], gradient[there] = own * np.outer(units, units), pull * units
    return result, gradient


def _em(information: Floats, gradient: Floats, factors: int, spread: Floats) -> tuple[Floats, Floats, Floats, float]:
    """Mean, spread, covariance of the mean, and ln p, from a first spread."""
    robots, count = gradient.shape
    before = -np.inf
    mean, of_mean = _mean(information, gradient, spread)
    for _ in range(STEPS):
        weight = np.linalg.inv(spread)
        own = np.linalg.inv(information + weight)
        found = np.einsum("rij,rj->ri", own, gradient + weight @ mean)
        answer = own @ weight - np.eye(count)
        away = found - mean
        scatter = (own + answer @ of_mean @ np.swapaxes(answer, 1, 2)).sum(axis=0) + away.T @ away
        spread = _factor_model(scatter / robots, factors, robots)
        mean, of_mean = _mean(information, gradient, spread)
        now = _log_likelihood(information, gradient, mean, spread)
        if abs(now - before) < SETTLED:
            break
        before = now
    return mean, spread, of_mean, now


def _mean(information: Floats, gradient: Floats, spread: Floats) -> tuple[Floats, Floats]:
    """μ (P,) and its covariance M (P, P) for a spread; μ ~ N(0, I) before any robot."""
    weight = np.linalg.inv(spread)
    own = np.linalg.inv(information + weight)
    # each robot's rows, with its own u integrated out, are about μ: information W − W V W, gradient W V η
    of_mean = np.linalg.inv(np.eye(len(spread)) + (weight - weight @ own @ weight).sum(axis=0))
    return of_mean @ (weight @ np.einsum("rij,rj->ri", own, gradient).sum(axis=0)), of_mean


def _factor_model(scatter: Floats, factors: int, robots: int) -> Floats:
    """D + L Lᵀ (P, P) nearest to a scatter (P, P), its diagonal drawn towards the tolerance as `BELIEVED` says."""
    target = (robots * scatter + BELIEVED * np.eye(len(scatter))) / (robots + BELIEVED)
    own = np.maximum(np.diag(target), SMALLEST)
    common = np.zeros_like(target)
    for _ in range(20 if factors else 0):
        scale = np.sqrt(own)
        values, vectors = np.linalg.eigh(target / np.outer(scale, scale))
        loads = scale[:, None] * vectors[:, -factors:] * np.sqrt(np.maximum(values[-factors:] - 1.0, 0.0))
        common = loads @ loads.T
        own = np.maximum(np.diag(target - common), SMALLEST)
    return np.diag(own) + common


def _log_likelihood(information: Floats, gradient: Floats, mean: Floats, spread: Floats) -> float:
    """ln p of all rows for robots from N(mean, spread), up to a constant."""
    weight = np.linalg.inv(spread)
    inner = information + weight
    right = gradient + weight @ mean
    squares = np.einsum("ri,ri->", right, np.linalg.solve(inner, right[..., None])[..., 0])
    volume = np.linalg.slogdet(inner)[1].sum() + len(gradient) * np.linalg.slogdet(spread)[1]
    return float(0.5 * (squares - volume - len(gradient) * mean @ weight @ mean))
