"""Distributions that tests and intervals need, by the functions of `scipy.special` that `scipy.stats` calls.

The import of `scipy.stats` takes longer than that of all of `cellctl.calibration`. The values are the same to the last
digit, but those of the binomial distribution: they differ by 1e-11, and are only compared with a threshold. `dof`:
degrees of freedom; `p`: a probability. Every function takes arrays, which broadcast.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from cellctl.kinematics._frames import Floats


def chi2_sf(x: ArrayLike, dof: ArrayLike) -> Floats:
    """Chi-squared: the probability of a larger value than x ≥ 0; 1 below zero."""
    return np.asarray(special.chdtrc(np.asarray(dof, float), np.maximum(x, 0.0)))


def chi2_isf(p: ArrayLike, dof: ArrayLike) -> Floats:
    """Chi-squared: the value that is exceeded with probability p; NaN for dof = 0."""
    dof = np.asarray(dof, float)
    return np.where(dof > 0.0, special.chdtri(np.maximum(dof, 1.0), np.asarray(p, float)), np.nan)


def chi2_ppf(p: ArrayLike, dof: ArrayLike) -> Floats:
    """Chi-squared: the p quantile."""
    return np.asarray(2.0 * special.gammaincinv(np.asarray(dof, float) / 2.0, np.asarray(p, float)))


def t_sf(x: ArrayLike, dof: ArrayLike) -> Floats:
    """Student's t: the probability of a larger value than x."""
    return np.asarray(special.stdtr(np.asarray(dof, float), -np.asarray(x, float)))


def t_ppf(p: ArrayLike, dof: ArrayLike) -> Floats:
    """Student's t: the p quantile; NaN for dof = 0."""
    dof = np.asarray(dof, float)
    return np.where(dof > 0.0, special.stdtrit(np.maximum(dof, 1.0), np.asarray(p, float)), np.nan)


def normal_sf(x: ArrayLike) -> Floats:
    """Standard normal: the probability of a larger value than x."""
    return np.asarray(special.ndtr(-np.asarray(x, float)))


def normal_ppf(p: ArrayLike) -> Floats:
    """Standard normal: the p quantile."""
    return np.asarray(special.ndtri(np.asarray(p, float)))


def f_sf(x: ArrayLike, between: ArrayLike, within: ArrayLike) -> Floats:
    """Fisher's F with numerator and denominator degrees of freedom: the probability of a larger value than x."""
    return np.asarray(
        special.fdtrc(np.asarray(between, float), np.asarray(within, float), np.maximum(x, 0.0))
    )  # fdtrc has NaN below zero


def f_isf(p: float, between: ArrayLike, within: ArrayLike) -> Floats:
    """Fisher's F: the value that is exceeded with probability p."""
    return np.asarray(special.fdtri(np.asarray(between, float), np.asarray(within, float), 1.0 - p))


def maxwell_cdf(x: ArrayLike) -> Floats:
    """Length of three independent standard normal values: the probability of x ≥ 0 or less."""
    return np.asarray(special.gammainc(1.5, np.square(np.asarray(x, float)) / 2.0))


def binomial_cdf(count: ArrayLike, trials: ArrayLike, p: float) -> Floats:
    """Binomial: the probability of `count` or fewer of `trials`."""
    return np.asarray(special.bdtr(np.asarray(count, float), np.asarray(trials, int), p))


def weighted_chi2_ppf(p: float, weights: ArrayLike) -> float:
    """Σ λᵢ zᵢ², zᵢ independent standard normal, λᵢ ≥ 0 the `weights` (K,): the p quantile, 0 < p < 1; 0 if all are 0.

    By a saddlepoint formula: the probability of a larger value is right to 0.002 at p = 0.95, to 0.014 at 0.5.
    """
    largest = float(np.max(weights, initial=0.0))
    if largest <= 0.0:
        return 0.0
    shares = np.asarray(weights, float) / largest
    shares = shares[shares > _NEGLIGIBLE]
    at = _root(lambda t: (1.0 - p) - _beyond(t, shares))
    return largest * _saddlepoint(at, shares)[0]


_NEGLIGIBLE = 1e-9
"""Weights below this share of the largest are left out: a million of them would change the sum by a thousandth."""

_MIDDLE = 1e-3
"""Nearer to the mean (|w| below this) Lugannani and Rice's formula loses its digits, and its limit there is used."""


def _root(function: Callable[[float], float]) -> float:
    from scipy.optimize import brentq  # at first use: it takes 0.2 s

    return float(brentq(function, -60.0, 30.0, xtol=1e-10))


def _saddlepoint(t: float, weights: Floats) -> tuple[float, Floats]:
    """x = K'(s), and 1 − 2 s λ (K,), for s = (1 − e⁻ᵗ)/2 < 1/(2 max λ), max λ = 1. K(s) = −½ Σ log(1 − 2 s λ) is the
    cumulant generating function.
    """
    factors = (1.0 - weights) + weights * np.exp(-t)
    return float(np.sum(weights / factors)), factors


def _beyond(t: float, weights: Floats) -> float:
    """P(Q > x) at the saddlepoint: Φ̄(w + log(v/w)/w), w = sign(s) √(2 (s x − K)), v = s √K″ (Lugannani and Rice 1980
    in Barndorff-Nielsen's form; Kuonen 1999, Saddlepoint approximations for distributions of quadratic forms in normal
    variables, Biometrika 86, 929–935). At the mean its limit is Φ̄(K‴/(6 K″^1.5)).
    """
    s, (x, factors) = -0.5 * float(np.expm1(-t)), _saddlepoint(t, weights)
    second, third = 2.0 * np.sum((weights / factors) ** 2), 8.0 * np.sum((weights / factors) ** 3)
    w = np.sign(s) * np.sqrt(2.0 * max(s * x + 0.5 * np.sum(np.log(factors)), 0.0))
    if abs(w) < _MIDDLE:
        return float(normal_sf(w + third / (6.0 * second**1.5)))
    return float(normal_sf(w + np.log(s * np.sqrt(second) / w) / w))
