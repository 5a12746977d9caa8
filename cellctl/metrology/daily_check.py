"""Daily check: a few points against a baseline, by Hotelling's T², a multivariate EWMA and a control chart.

The baseline gives the centre line x̄ and σ from the mean moving range of two successive values, MR̄ / d₂ with d₂ = 1.128,
so that a slow trend in the baseline does not widen the limits as a standard deviation would:

    limits x̄ ± 3 MR̄ / d₂,  upper limit of the moving range D₄ MR̄,  D₄ = 3.267

(ISO 7870-2; NIST/SEMATECH e-Handbook of Statistical Methods, 6.3.2.2). Runs of points signal by the rules of 6.3.2.
The values have to be independent and about normal: without a change 0.27 % of them are beyond the limits.

The numbers of a run (ten points: 30) are reduced to a few linear features: motion as a whole, scale, or joint zeros. T²
sees a sudden change, the EWMA (exponentially weighted moving average) a slow one. The limit of T² is exact for normal
noise and the stated false-alarm rate per run:

    T² = (x − x̄)ᵀ S⁻¹ (x − x̄),  limit k (m + 1)(m − 1) / (m (m − k)) · F(1 − α; k, m − k)

for a new run and m baseline runs of k features. The EWMA Z_t = λ (x_t − x̄) + (1 − λ) Z_{t−1} is judged by
Z_tᵀ S⁻¹ Z_t / (λ/(2 − λ) (1 − (1 − λ)^2t)) > L². L depends on m, as x̄ and S are estimates; it is found by simulation
(Lowry et al. 1992 for MEWMA; Montgomery, Introduction to Statistical Quality Control, for both charts).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.calibration.distributions import f_isf
from cellctl.kinematics import Bools, Floats
from cellctl.metrology.measured_points import block_diagonal
from cellctl.metrology.measured_pose import rigid_transform

D2, D4 = 1.128, 3.267
"""For ranges of two values: mean range in σ, and upper limit of a range in mean ranges."""

LEAST_BASELINE = 2
RUN_OF_SIDE, RUN_OF_TREND = 8, 6
"""Length of a run of points that signals: on one side of the centre line; each above (or each below) the one before."""

LEAST_RUNS = 20
"""DailyBaseline runs below which nothing is judged."""
SPARE_RUNS = 5
"""DailyBaseline runs needed beyond the number of features."""

SCALE = "scale"
RIGID_AND_SCALE = ("x", "y", "z", "turn x", "turn y", "turn z", SCALE)

HORIZON = 100
"""Runs over which the EWMA's false-alarm rate holds on average."""
_DRAWS = 4000
_SEED = 20240811


class Signal(StrEnum):
    """A rule by which a point signals that the process has changed."""

    BEYOND = "beyond 3 σ"
    RANGE = "moving range beyond its limit"
    ONE_SIDE = f"{RUN_OF_SIDE} points on one side"
    RISING = f"{RUN_OF_TREND} points rising"
    FALLING = f"{RUN_OF_TREND} points falling"


@final
@dataclass(frozen=True, eq=False)
class ControlChart:
    """The chart of n values in their order and unit.

    values (n,); ranges (n,): absolute difference from the value before, NaN for the first. centre, sigma: from the
    first `baseline` values; mean_range: MR̄. signals (n,): of each point the rules by which it signals.
    """

    values: Floats
    ranges: Floats
    baseline: int
    centre: float
    mean_range: float
    signals: tuple[tuple[Signal, ...], ...]

    @property
    def sigma(self) -> float:
        """Standard deviation of a value without a change."""
        return self.mean_range / D2

    @property
    def limits(self) -> tuple[float, float]:
        """Lower and upper limit of a value."""
        return self.centre - 3.0 * self.sigma, self.centre + 3.0 * self.sigma

    @property
    def range_limit(self) -> float:
        """Upper limit of a moving range; the lower one is 0."""
        return D4 * self.mean_range

    @property
    def signalling(self) -> list[int]:
        """Indices of the points that signal."""
        return [point for point, rules in enumerate(self.signals) if rules]


def control_chart(values: ArrayLike, baseline: int) -> ControlChart:
    """The chart of `values` (n,), oldest first; the first `baseline` of them (or all, where there are fewer) give the
    limits. Raises ValueError for fewer than two, or a value that is not finite.
    """
    found = np.asarray(values, float)
    used = min(baseline, len(found))
    if used < LEAST_BASELINE:
        raise ValueError(f"{used} values for the baseline: a moving range needs {LEAST_BASELINE} at least")
    if not np.isfinite(found).all():
        raise ValueError("a value is missing: leave its check out")
    ranges = np.append(np.nan, np.abs(np.diff(found)))
    centre, mean_range = float(found[:used].mean()), float(ranges[1:used].mean())
    return ControlChart(found, ranges, used, centre, mean_range, _signals(found, ranges, centre, mean_range))


def _signals(values: Floats, ranges: Floats, centre: float, mean_range: float) -> tuple[tuple[Signal, ...], ...]:
    steps = np.append(0.0, np.diff(values))
    by_rule = {
        Signal.BEYOND: np.abs(values - centre) > 3.0 * mean_range / D2,
        Signal.RANGE: np.nan_to_num(ranges) > D4 * mean_range,
        Signal.ONE_SIDE: _in_a_row(values > centre, RUN_OF_SIDE) | _in_a_row(values < centre, RUN_OF_SIDE),
        Signal.RISING: _in_a_row(steps > 0.0, RUN_OF_TREND - 1),  # six points are five steps
        Signal.FALLING: _in_a_row(steps < 0.0, RUN_OF_TREND - 1),
    }
    return tuple(tuple(rule for rule, points in by_rule.items() if points[point]) for point in range(len(values)))


def _in_a_row(points: Bools, count: int) -> Bools:
    """Which points (n,) are the last of `count` or more true ones in a row."""
    lengths, length = np.zeros(len(points), int), 0
    for place, true in enumerate(points):
        length = length + 1 if true else 0
        lengths[place] = length
    return np.asarray(lengths >= count)


class DailyAction(StrEnum):
    """What to do."""

    IN_CONTROL = "in control"
    REPEAT = "measure again"
    RECALIBRATE = "recalibrate"


class DailyReason(StrEnum):
    """Why."""

    NONE = "none"
    SHIFT = "shift"
    SCALE = "scale"
    DRIFT = "drift"


@final
@dataclass(frozen=True, slots=True)
class CheckLimits:
    """false_alarm: probability per run of each chart without a change. weight: λ of the EWMA."""

    false_alarm: float = 0.0027
    weight: float = 0.2


@final
@dataclass(frozen=True, eq=False)
class DailyBaseline:
    """DailyBaseline runs as features. nominal (p,): what is subtracted; basis (p, k): its columns in mm; names (k,).

    mean (k,), covariance (k, k): of `runs` runs.
    """

    nominal: Floats
    basis: Floats
    names: tuple[str, ...]
    mean: Floats
    covariance: Floats
    runs: int

    @classmethod
    def of(cls, runs: ArrayLike, nominal: ArrayLike, basis: Floats, names: tuple[str, ...]) -> DailyBaseline:
        """From runs (m, …) of the same numbers as `nominal`. Raises ValueError for too few runs for the features."""
        values, origin = np.asarray(runs, float), np.asarray(nominal, float).ravel()
        flat = values.reshape(len(values), -1)
        least = max(LEAST_RUNS, basis.shape[1] + SPARE_RUNS)
        if len(flat) < least:
            raise ValueError(f"{len(flat)} baseline runs for {basis.shape[1]} features: measure {least} at least")
        if not np.isfinite(flat).all():
            raise ValueError("a baseline run has missing numbers: leave it out")
        each = _features(flat, origin, basis)
        return cls(
            origin, basis, names, each.mean(axis=0), np.cov(each, rowvar=False).reshape(len(names), -1), len(flat)
        )

    def features(self, run: ArrayLike) -> Floats:
        """Features (k,) of one run, less the baseline's mean."""
        each = _features(np.asarray(run, float).ravel()[None], self.nominal, self.basis)
        return np.asarray(each[0] - self.mean)


@final
@dataclass(frozen=True, eq=False)
class DailyVerdict:
    """action and reason; t2, ewma with their limits; features (k,): standardised deviations; words: a sentence."""

    action: DailyAction
    reason: DailyReason
    t2: float
    t2_limit: float
    ewma: float
    ewma_limit: float
    features: Floats
    words: str


def in_one_frame(points: Sequence[ArrayLike], nests: Sequence[ArrayLike], spread: Sequence[ArrayLike]) -> Floats:
    """Points (R, P, 3), mm, of all R runs in the instrument's frame of the first: the nests carry them there.

    So it does not matter where the instrument stands. points: (P, 3) of each run, in its own frame; nests (N, 3), their
    covariances spread (N, 3, 3), mm².
    """
    there, first_spread = np.asarray(nests[0], float), np.asarray(spread[0], float)
    found = []
    for measured, here, own in zip(points, nests, spread, strict=True):
        covariance = block_diagonal(np.asarray(own, float) + first_spread)
        matrix = rigid_transform(np.asarray(here, float), there, covariance).pose.matrix
        found.append(np.asarray(measured, float) @ matrix[:3, :3].T + matrix[:3, 3])
    return np.array(found)


def rigid_and_scale(points: ArrayLike) -> Floats:
    """Basis (3N, 7) at points (N, 3), mm: slides, turns about their middle, scale; all per mm of RMS motion."""
    places = np.asarray(points, float)
    away = places - places.mean(axis=0)
    turns = [np.cross(axis, away) for axis in np.eye(3)]
    shapes = [*turns, away]
    scaled = [shape / max(float(np.sqrt((shape**2).sum(axis=1).mean())), 1e-9) for shape in shapes]
    slides = [np.tile(axis, (len(away), 1)) for axis in np.eye(3)]
    return np.stack([shape.ravel() for shape in (*slides, *scaled)], axis=1)


def deviations(runs: ArrayLike, baseline: int) -> Floats:
    """Features (R, k), mm, of runs (R, P, 3) in one frame, less the mean of the first `baseline` of them."""
    places = np.asarray(runs, float)
    nominal = places[:baseline].mean(axis=0)
    flat = places.reshape(len(places), -1)
    return _features(flat, nominal.ravel(), rigid_and_scale(nominal))


def t2_limit(runs: int, features: int, false_alarm: float) -> float:
    """Limit of T² for a new run, exact for normal noise."""
    factor = features * (runs + 1) * (runs - 1) / (runs * (runs - features))
    return float(factor * f_isf(false_alarm, features, runs - features))


@lru_cache(maxsize=32)
def ewma_limit(runs: int, features: int, weight: float, false_alarm: float) -> float:
    """L of the EWMA, by simulated baselines and runs: P(alarm within 100 runs) = 1 − (1 − false_alarm)^100.

    The statistic does not depend on mean and covariance of the noise, so that one simulation serves all.
    """
    highest = simulated_ewma(runs, features, weight, HORIZON, np.random.default_rng(_SEED)).max(axis=1)
    return float(np.sqrt(np.quantile(highest, (1.0 - false_alarm) ** HORIZON)))


def simulated_ewma(runs: int, features: int, weight: float, horizon: int, rng: np.random.Generator) -> Floats:
    """EWMA statistics (draws, horizon) in control, each draw with a baseline of its own."""
    baseline = rng.normal(size=(_DRAWS, runs, features))
    mean = baseline.mean(axis=1)
    away = baseline - mean[:, None]
    inverse = np.linalg.inv(np.swapaxes(away, 1, 2) @ away / (runs - 1))
    result, average = np.empty((_DRAWS, horizon)), np.zeros((_DRAWS, features))
    for run in range(horizon):
        average = weight * (rng.normal(size=average.shape) - mean) + (1.0 - weight) * average
        result[:, run] = np.einsum("di,dij,dj->d", average, inverse, average) / _ewma_variance(weight, run + 1)
    return result


def daily_check(baseline: DailyBaseline, runs: ArrayLike, limits: CheckLimits | None = None) -> DailyVerdict:
    """Judge the last of the runs (t, …) since the baseline, oldest first.

    One run beyond the limit of T² is measured again, and left out of the EWMA if the next one is within; two in a row,
    or an alarm of the EWMA, say *recalibrate*. The reason is `drift` where the EWMA alone sees it, else `scale` or
    `shift` by the largest feature. Raises ValueError where a run has missing numbers.
    """
    limits = limits or CheckLimits()
    each = np.array([baseline.features(run) for run in np.asarray(runs, float)])
    if not len(each) or not np.isfinite(each).all():
        raise ValueError("the run has missing numbers: measure the missing points again")
    inverse, count = np.linalg.inv(baseline.covariance), len(baseline.names)
    t2 = np.einsum("ti,ij,tj->t", each, inverse, each)
    limit = t2_limit(baseline.runs, count, limits.false_alarm)
    beyond = t2 > limit
    kept = each[~beyond | np.append(beyond[1:], False) | np.append(False, beyond[:-1])]
    average = np.zeros(count)
    for run in kept:
        average = limits.weight * run + (1.0 - limits.weight) * average
    average /= np.sqrt(_ewma_variance(limits.weight, max(len(kept), 1)))
    ewma = float(np.sqrt(average @ inverse @ average))
    highest = ewma_limit(baseline.runs, count, limits.weight, limits.false_alarm)
    scaled = (each[-1] if beyond[-1] else average) / np.sqrt(np.diag(baseline.covariance))
    largest = int(np.abs(scaled).argmax())
    action, reason = _action(beyond, ewma > highest, baseline.names[largest])
    words = _words(action, reason, baseline.names[largest], float(scaled[largest]))
    return DailyVerdict(action, reason, float(t2[-1]), limit, ewma, highest, scaled, words)


def _action(beyond: Bools, slow: bool, largest: str) -> tuple[DailyAction, DailyReason]:
    """By which runs were beyond the limit of T² (t,), the EWMA's alarm, and the largest feature."""
    if not beyond[-1]:
        return (DailyAction.RECALIBRATE, DailyReason.DRIFT) if slow else (DailyAction.IN_CONTROL, DailyReason.NONE)
    again = len(beyond) > 1 and bool(beyond[-2])
    return (
        DailyAction.RECALIBRATE if again else DailyAction.REPEAT,
        DailyReason.SCALE if largest == SCALE else DailyReason.SHIFT,
    )


def _words(action: DailyAction, reason: DailyReason, largest: str, size: float) -> str:
    if action is DailyAction.IN_CONTROL:
        return "The robot is as in the baseline."
    what = {
        DailyReason.SHIFT: "the points moved together",
        DailyReason.SCALE: "the distances between the points changed together",
        DailyReason.DRIFT: "the points change slowly from run to run",
    }[reason]
    cure = "Measure the points again." if action is DailyAction.REPEAT else "Recalibrate."
    return f"{what[0].upper()}{what[1:]} (largest: {largest}, {size:+.1f} σ). {cure}"


def _ewma_variance(weight: float, run: int) -> float:
    """Variance of the EWMA after `run` runs, in those of a run."""
    return weight / (2.0 - weight) * (1.0 - (1.0 - weight) ** (2 * run))


def _features(values: Floats, nominal: Floats, basis: Floats) -> Floats:
    return np.asarray(np.linalg.lstsq(basis, (values - nominal).T, rcond=None)[0].T)
