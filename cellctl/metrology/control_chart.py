"""Control chart of individual values with its chart of moving ranges (Shewhart).

The baseline gives the centre line x̄ and σ from the mean moving range of two successive values, MR̄ / d₂ with d₂ = 1.128,
so that a slow trend in the baseline does not widen the limits as a standard deviation would:

    limits x̄ ± 3 MR̄ / d₂,  upper limit of the moving range D₄ MR̄,  D₄ = 3.267

(ISO 7870-2; NIST/SEMATECH e-Handbook of Statistical Methods, 6.3.2.2). Runs of points signal by the rules of 6.3.2.
The values have to be independent and about normal: without a change 0.27 % of them are beyond the limits.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.kinematics import Bools, Floats

D2, D4 = 1.128, 3.267
"""For ranges of two values: mean range in σ, and upper limit of a range in mean ranges."""

LEAST_BASELINE = 2
RUN_OF_SIDE, RUN_OF_TREND = 8, 6
"""Length of a run of points that signals: on one side of the centre line; each above (or each below) the one before."""


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
