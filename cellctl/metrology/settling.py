"""Whether a point has come to rest: scatter and trend of its last samples, with a t-test on the slope.

For the warm-up (one posture measured again and again) and for vibration after a move (samples of one point). Doubt
means not settled: the trend's upper confidence bound has to be below the limit, not only its estimate.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from cellctl.kinematics import Floats


@final
@dataclass(frozen=True, slots=True)
class SettlingLimits:
    """samples: how many of the last ones count, at least 4. scatter_mm: 3-D RMS about their trend. drift_mm: motion
    over the time that these samples span. confidence: one-sided, of the bound on the drift.
    """

    samples: int = 6
    scatter_mm: float = 0.05
    drift_mm: float = 0.05
    confidence: float = 0.95


@final
@dataclass(frozen=True, slots=True)
class Settling:
    """settled: within both limits. scatter_mm: 3-D RMS about the trend. drift_mm: length of the motion over the span.

    drift_bound_mm: its upper bound with the stated confidence. slope_mm_s: along the drift. p_value: of a t-test of no
    slope along the drift's direction, of the worst axis times three (Bonferroni). reason: in words what is not settled.
    """

    settled: bool
    scatter_mm: float
    drift_mm: float
    drift_bound_mm: float
    slope_mm_s: float
    p_value: float
    reason: str


def settling(times_s: ArrayLike, xyz: ArrayLike, limits: SettlingLimits) -> Settling:
    """Judge the last `limits.samples` of points (N, 3), mm, at times (N,), s; too few of them are not settled.

    Each axis has a line fitted to it: slope b, its σ = s / √Σ(t − t̄)² with N − 2 degrees of freedom. The bound is
    |b| T + t(confidence, N − 2) σ_b T with |b| over the three axes and the mean σ_b of an axis.
    """
    times, places = np.asarray(times_s, float), np.asarray(xyz, float)
    if limits.samples < 4:
        raise ValueError("settling needs at least 4 samples for a trend with its uncertainty")
    if len(times) < limits.samples:
        reason = f"{len(times)} of {limits.samples} samples: measure on"
        return Settling(False, np.inf, np.inf, np.inf, np.nan, np.nan, reason)
    times, places = times[-limits.samples :], places[-limits.samples :]
    slopes, sigma, rest = _lines(times, places)
    span, free = float(np.ptp(times)), limits.samples - 2
    scatter = float(np.sqrt((rest**2).sum() / free))
    drift = float(np.linalg.norm(slopes)) * span
    bound = drift + float(stats.t.ppf(limits.confidence, free) * np.sqrt((sigma**2).mean())) * span
    ratios = np.divide(slopes, sigma, out=np.zeros(3), where=sigma > 0.0)
    p_value = min(1.0, 3.0 * float(2.0 * stats.t.sf(np.abs(ratios).max(), free)))
    reason = _reason(limits, scatter, bound)
    return Settling(not reason, scatter, drift, bound, float(np.linalg.norm(slopes)), p_value, reason)


def _lines(times: Floats, places: Floats) -> tuple[Floats, Floats, Floats]:
    """Slope of each axis (3,), its standard deviation (3,), and residuals (N, 3). Raises ValueError for equal times."""
    centred = times - times.mean()
    spread = float(centred @ centred)
    if spread == 0.0:
        raise ValueError("the samples have one and the same time: no trend can be found")
    slopes = centred @ places / spread
    rest = places - places.mean(axis=0) - centred[:, None] * slopes
    sigma = np.sqrt((rest**2).sum(axis=0) / (len(times) - 2) / spread)
    return slopes, sigma, rest


def _reason(limits: SettlingLimits, scatter: float, bound: float) -> str:
    if scatter > limits.scatter_mm:
        return f"scatter {scatter:.4f} mm is above {limits.scatter_mm:g}: wait, or look for vibration"
    if bound > limits.drift_mm:
        return f"drift up to {bound:.4f} mm over {limits.samples} samples is above {limits.drift_mm:g}: wait"
    return ""
