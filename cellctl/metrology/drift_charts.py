"""Drift of parameters over a robot's runs: control charts of an exponentially weighted moving average (EWMA).

Run i of a robot, at any time, gives a parameter x_i with its own σ_i. The chart compares two weighted means. Recent is
the EWMA (Roberts 1959; Lucas & Saccucci 1990; Montgomery, Introduction to Statistical Quality Control, 9.1)

    Z_t = Σ c_i x_i / Σ c_i,  c_i = λ (1 − λ)^(t − i),  over the runs i = 1 … t after the reference.

Its weights are divided by their sum: that is the correction of its start, so that no old value is assumed. λ counts
runs, not days: a run is information whenever it is made. The reference is the mean, weighted by 1/σ², of the
calibration (run 0) and of the first few runs after it:

    R_t = Σ_{i ∈ B, i < t} x_i / σ_i² / P_t,  P_t = Σ_{i ∈ B, i < t} 1 / σ_i².

The error of R_t is common to all later points and no average of them removes it. It is therefore in the variance of
their difference, in which baseline runs that are in both means count with their covariance:

    Var(Z_t − R_t) = Σ c_i² σ_i² / (Σ c_i)² + 1 / P_t − 2 (Σ_{i ∈ B, 0 < i < t} c_i / Σ c_i) / P_t.

u_t = (Z_t − R_t) / √Var is a linear contrast (its weights add up to 0), so without a change it is exactly N(0, 1) for
normal errors with these σ: at each run, for any times, σ_i and λ. That gives the limit. A robot of p charts with N
runs in five years is outside ± L on average in p N 2 Φ(−L) pairs of chart and run, however the charts and the runs
depend on each other. An alarm is at least one such pair. So with

    L = Φ⁻¹(1 − 1 / (2 p N))

the expected number of false alarms of one robot, all its charts together, is at most one in five years. N is by the
robot's own rate. This is a proved bound: the exact number is smaller, as an EWMA that is outside stays there for some
runs. Lowry et al. (1992) chart one quadratic form of all parameters; here each parameter has a chart of its own, as
the parameter that moved is the answer wanted, and as only σ, no covariance, is needed of each run.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.calibration.distributions import normal_ppf
from cellctl.kinematics import Floats

WEIGHT: Final = 0.2
"""λ. Smaller finds smaller shifts, larger finds them sooner; 0.05 … 0.25 is usual (Montgomery, 9.1.2)."""

BASELINE: Final = 4
"""Number of runs after the calibration that are part of the reference: its σ is then about 0.45 of that of a run. Part
of a change or an outlier within these runs is in the reference. None is left out for being far from the others: that
would make a calibration with a large error the reference alone, and raise the rate of false alarms by two thirds."""

RECENT: Final = 5
"""Number of runs that say how far a parameter is now; an EWMA with λ = 0.2 holds the information of nine."""

_MEDIAN_CHI2: Final = 0.454936
"""Median of χ² with one degree of freedom."""


@final
@dataclass(frozen=True, eq=False)
class DriftCharts:
    """Charts of R runs, oldest first. mean (R, …): EWMA less reference; sigma (R, …): 1 σ of that, in the same unit.

    NaN where nothing is judged: at the first run, and where a run does not have the parameter. reference (…): after the
    last run.
    """

    mean: Floats
    sigma: Floats
    reference: Floats

    @property
    def ratio(self) -> Floats:
        """u (R, …), N(0, 1) without a change."""
        return np.asarray(self.mean / self.sigma)


def drift_charts(
    values: ArrayLike, sigmas: ArrayLike, *, weight: float = WEIGHT, baseline: int = BASELINE
) -> DriftCharts:
    """Charts of values (R, …) with 1 σ (R, …), in one unit; the first value of each chart is the calibration.

    NaN: the run does not have the parameter. Raises ValueError if a known value has no positive σ.
    """
    found, spread = np.asarray(values, float), np.asarray(sigmas, float)
    known = np.isfinite(found)
    if not np.all(spread[known] > 0.0):
        raise ValueError("a value has no positive σ")
    x, variance = np.where(known, found, 0.0), np.where(known, spread, 1.0) ** 2
    mean, sigma = np.full(found.shape, np.nan), np.full(found.shape, np.nan)
    count, precision, reference, total, weights, squares, shared = np.zeros((7, *found.shape[1:]))
    for run in range(len(found)):
        judged = known[run] & (count > 0)
        keep, new = np.where(judged, 1.0 - weight, 1.0), np.where(judged, weight, 0.0)
        total, weights, shared = keep * total + new * x[run], keep * weights + new, keep * shared
        squares = keep**2 * squares + new**2 * variance[run]
        with np.errstate(divide="ignore", invalid="ignore"):
            both = squares / weights**2 + (1.0 - 2.0 * shared / weights) / precision
            mean[run] = np.where(judged, total / weights - reference / precision, np.nan)
            sigma[run] = np.sqrt(np.where(judged, both, np.nan))
        joins = known[run] & (count <= baseline)  # after it was judged: a run is never in its own reference
        precision = precision + joins / variance[run]
        reference = reference + joins * x[run] / variance[run]
        shared, count = shared + joins * new, count + known[run]
    with np.errstate(divide="ignore", invalid="ignore"):
        return DriftCharts(mean, sigma, np.asarray(reference / precision))


def recent_change(values: Floats, sigmas: Floats, since: int) -> tuple[float, float]:
    """How far one parameter, values (R,) with 1 σ (R,), now is from its reference, and 1 σ of that.

    By the weighted mean of its last runs, up to `RECENT` and none before run `since`, less that of the reference's runs
    before it: the EWMA still holds runs from before a step, the reference may hold some after it, and their difference
    would be too small.
    """
    known = np.flatnonzero(np.isfinite(values))
    weights = np.zeros(len(values))
    for part, sign in ((known[known < since][: BASELINE + 1], -1.0), (known[known >= since][-RECENT:], 1.0)):
        precision = sigmas[part] ** -2.0
        weights[part] += sign * precision / precision.sum()
    change = weights[known] @ values[known]
    return float(change), float(np.linalg.norm(weights[known] * sigmas[known]))


def alarm_limit(charts: int, runs: float, alarms: float = 1.0) -> float:
    """L: with it `charts` charts are outside ± L in at most `alarms` of `runs` runs on average without a change."""
    return float(normal_ppf(1.0 - min(0.5 * alarms / (charts * runs), 0.5)))


def found_shift(
    limit: float, sigma: ArrayLike, runs: ArrayLike, probability: float = 0.9, *, weight: float = WEIGHT
) -> Floats:
    """The step that `runs` runs after it is outside ± `limit` with this probability, in the unit of sigma.

    sigma: of the chart's mean at that run. A lower bound of what is found: an earlier run may be outside too.
    """
    share = 1.0 - (1.0 - weight) ** np.asarray(runs, float)
    return np.asarray((limit + normal_ppf(probability)) * np.asarray(sigma, float) / share)


def squared_differences(values: ArrayLike, sigmas: ArrayLike) -> Floats:
    """Of values (R, …) in following runs (R − 1, …): squares in units of their variance, χ² with one degree of freedom
    where σ is right. NaN where one of the two is missing. A slow drift and a single step hardly count in them.
    """
    x, spread = np.asarray(values, float), np.asarray(sigmas, float)
    return np.asarray((x[1:] - x[:-1]) ** 2 / (spread[1:] ** 2 + spread[:-1] ** 2))


def noise_scale(squares: ArrayLike) -> float:
    """The factor by which the scatter from run to run exceeds the stated σ, by the median of `squared_differences`.

    The median is of a half of the runs, so that a few steps and outliers do not count. NaN without a value.
    """
    known = np.asarray(squares, float)
    known = known[np.isfinite(known)]
    return float(np.sqrt(np.median(known) / _MEDIAN_CHI2)) if known.size else float("nan")


def scale_error(count: ArrayLike) -> Floats:
    """1 σ of `noise_scale`, relative, by `count` differences where σ is right.

    The median's efficiency is 0.37 of the mean square's, whose relative σ is 1/√(2 n); following differences share a
    value, which widens it by another tenth (by simulation in the tests).
    """
    return np.asarray(1.3 / np.sqrt(np.asarray(count, float)))


def common_change(means: ArrayLike, sigmas: ArrayLike) -> tuple[Floats, Floats]:
    """What most of n robots have in common, of independent charts (n, …): change and its 1 σ; NaN is left out.

    By the median of u = mean / σ, which a few robots that moved alone hardly change. Its variance without a change is
    π / (2 n) at most: that of large n, and less for few. The change is in the unit of the charts by their median σ.
    """
    mean, sigma = np.asarray(means, float), np.asarray(sigmas, float)
    ratio, count = _median(np.asarray(mean / sigma))
    size, _ = _median(np.where(np.isfinite(mean), sigma, np.nan))
    return np.asarray(ratio * size), np.asarray(size * np.sqrt(0.5 * np.pi / np.maximum(count, 1)))


def _median(values: Floats) -> tuple[Floats, Floats]:
    """Median along the first axis without NaN, and the number of values; np.nanmedian takes ten times as long."""
    count = np.isfinite(values).sum(axis=0)
    ordered = np.sort(values, axis=0)  # NaN last
    low, high = np.maximum((count - 1) // 2, 0), np.minimum(count // 2, len(values) - 1)
    middle = [np.take_along_axis(ordered, place[None], axis=0)[0] for place in (low, high)]
    return np.asarray(0.5 * (middle[0] + middle[1])), np.asarray(count)
