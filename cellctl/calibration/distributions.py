"""Distributions that tests and intervals need, by the functions of `scipy.special` that `scipy.stats` calls.

The import of `scipy.stats` takes longer than that of all of `cellctl.calibration`. The values are the same to the last
digit, but those of the binomial distribution: they differ by 1e-11, and are only compared with a threshold. `dof`:
degrees of freedom; `p`: a probability. Every function takes arrays, which broadcast.
"""

from __future__ import annotations

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
