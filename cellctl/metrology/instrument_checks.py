"""Checks of an instrument: settled points, two-face errors, and the error of the reflector constant.

For the warm-up (one posture measured again and again) and for vibration after a move (samples of one point). Doubt
means not settled: the trend's upper confidence bound has to be below the limit, not only its estimate.

The faces reverse collimation, index and tilting-axis errors; an instrument out of adjustment shows them here before a
campaign, and at its end whether they changed (ISO 10360-10 has the same test for laser trackers).

A wrong constant k makes every range longer by k: along each beam u. A distance between two nests then changes by
k (u1 − u2)·e, with e from nest 2 to nest 1: by 2 k with the station between them, in line; by nothing with both nests
in line on one side. A robot's scale takes most of such an error for its own, so that its residuals do not show it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.calibration.distributions import normal_sf, t_ppf, t_sf
from cellctl.kinematics import Floats
from cellctl.metrology.measured_points import Points, block_diagonal


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
    bound = drift + float(t_ppf(limits.confidence, free) * np.sqrt((sigma**2).mean())) * span
    ratios = np.divide(slopes, sigma, out=np.zeros(3), where=sigma > 0.0)
    p_value = min(1.0, 3.0 * float(2.0 * t_sf(np.abs(ratios).max(), free)))
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


CURE = "adjust the instrument (check and adjust: collimation, vertical index), then start again"


@final
@dataclass(frozen=True, slots=True)
class TwoFaceLimits:
    """Largest error across the beam at any point, and largest change of it during a campaign, mm."""

    error_mm: float
    change_mm: float


@final
@dataclass(frozen=True, slots=True)
class TwoFaceCheck:
    """passed; worst: index of the worst point; worst_mm: its error; rms_mm; reason: in words why it did not pass."""

    passed: bool
    worst: int
    worst_mm: float
    rms_mm: float
    reason: str


def two_face_check(across_mm: ArrayLike, limits: TwoFaceLimits, before_mm: ArrayLike | None = None) -> TwoFaceCheck:
    """Judge errors (N, 2), horizontal and vertical, mm at the reflector, of N points.

    before_mm (N, 2): of the same points at the start of the campaign; the worst point is then that of the change, if
    the change is the part that does not pass. Raises ValueError for values that are not finite.
    """
    errors = np.atleast_2d(np.asarray(across_mm, float))
    if not np.isfinite(errors).all() or not errors.size:
        raise ValueError("two-face errors are missing or not finite: measure them again")
    length = np.linalg.norm(errors, axis=1)
    rms, worst = float(np.sqrt((length**2).mean())), int(length.argmax())
    if length[worst] > limits.error_mm:
        reason = f"two-face error {length[worst]:.3f} mm at point {worst + 1} is above {limits.error_mm:g} mm: {CURE}"
        return TwoFaceCheck(False, worst, float(length[worst]), rms, reason)
    if before_mm is not None:
        change = np.linalg.norm(errors - np.asarray(before_mm, float), axis=1)
        most = int(change.argmax())
        if change[most] > limits.change_mm:
            reason = (
                f"the two-face error at point {most + 1} changed by {change[most]:.3f} mm since the start, more than "
                f"{limits.change_mm:g} mm: let the instrument reach the room's temperature, {CURE}"
            )
            return TwoFaceCheck(False, most, float(change[most]), rms, reason)
    return TwoFaceCheck(True, worst, float(length[worst]), rms, "")


LEAST_SENSITIVITY = 0.2
"""Change of a distance per change of the constant below which it says too little of it."""


class InsensitiveDistances(ValueError):
    """No known distance changes with the reflector constant; the text says what to do."""


class KnownDistance(NamedTuple):
    """Distance between nests `first` and `second` (indices), mm, and its standard deviation."""

    first: int
    second: int
    mm: float
    sigma_mm: float


@final
@dataclass(frozen=True, slots=True)
class ConstantError:
    """error_mm: how much too large every range is, with sigma_mm; subtract it from the constant if `wrong`.

    zero_sigma_mm: 1 σ of the zero of the instrument's range, which looks the same. p_value: of this estimate if there
    is no other error than that. sensitivity: the largest change of a distance per change of the constant.
    """

    error_mm: float
    sigma_mm: float
    zero_sigma_mm: float
    p_value: float
    sensitivity: float
    wrong: bool


def constant_error(
    nests: Points, distances: Sequence[KnownDistance], *, scale_ppm: float = 1.0, alpha: float = 1e-3
) -> ConstantError:
    """Estimate it by generalised least squares from nests (N) in the instrument's frame and known distances.

    scale_ppm: σ of the instrument's scale, the same in all distances. The zero of its range is known to the common part
    of the points along their beams: an error of that size is no sign of a wrong constant. Raises InsensitiveDistances
    where no distance changes by at least a fifth of the constant's error.
    """
    pairs = [(one.first, one.second) for one in distances]
    rows, sensitivity = _rows(nests.xyz, pairs)
    if not len(pairs) or np.abs(sensitivity).max() < LEAST_SENSITIVITY:
        raise InsensitiveDistances(
            "no known distance between nests changes with the reflector constant: give a certified distance between "
            "two nests that the station sees in different directions, best with the station between them"
        )
    found = np.array([np.linalg.norm(nests.xyz[i] - nests.xyz[j]) for i, j in pairs])
    known, sigma = np.array([one.mm for one in distances]), np.array([one.sigma_mm for one in distances])
    covariance = rows @ block_diagonal(nests.alone) @ rows.T + np.diag(sigma**2)
    covariance += (scale_ppm * 1e-6) ** 2 * np.outer(found, found)
    weighted = np.linalg.solve(covariance, sensitivity)
    spread = 1.0 / float(sensitivity @ weighted)
    error = spread * float(weighted @ (found - known))
    zero = float(nests.range_sigma.max())
    p_value = float(2.0 * normal_sf(abs(error) / np.hypot(np.sqrt(spread), zero)))
    return ConstantError(
        error, float(np.sqrt(spread)), zero, p_value, float(np.abs(sensitivity).max()), p_value < alpha
    )


def _rows(xyz: Floats, pairs: Sequence[tuple[int, int]]) -> tuple[Floats, Floats]:
    """Derivatives of the distances by the points (D, 3N), and by the constant (D,)."""
    beams = xyz / np.linalg.norm(xyz, axis=1, keepdims=True)
    rows, sensitivity = np.zeros((len(pairs), len(xyz), 3)), np.zeros(len(pairs))
    for row, (i, j) in enumerate(pairs):
        between = xyz[i] - xyz[j]
        unit = between / np.linalg.norm(between)
        rows[row, i], rows[row, j] = unit, -unit
        sensitivity[row] = (beams[i] - beams[j]) @ unit
    return rows.reshape(len(pairs), -1), sensitivity
