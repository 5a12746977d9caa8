"""When a smooth gap opens or closes inside a stretch of time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

Gap = Callable[[int], float]
"""Gap in mm at a time in nanoseconds; closed where it is not above zero."""

_GOLDEN = 0.3819660112501051
_NEAREST_NS = 1000


def crossings(gap: Gap, times: Sequence[int]) -> list[tuple[int, bool]]:
    """Each change inside `times` (ascending, at least two samples) as (first nanosecond after it, closed).

    `gap` is looked at at the sample times; between two of opposite sign the root is bisected to the nanosecond, and
    where three lie on one side with the middle one nearest to zero, the extremum between is looked for.
    """
    gaps = [gap(time) for time in times]
    knots = list(zip(times, gaps, strict=True))
    for i in range(len(times) - 2, 0, -1):
        if _bends_towards_zero(gaps[i - 1 : i + 2]):
            knots.insert(i + 1, _extremum(gap, times[i - 1], times[i + 1], knots[i]))
    knots.sort()
    return [
        (_root(gap, a, b, g_b <= 0), g_b <= 0) for (a, g_a), (b, g_b) in pairwise(knots) if (g_a <= 0) != (g_b <= 0)
    ]


def _bends_towards_zero(gaps: Sequence[float]) -> bool:
    before, middle, after = gaps
    if min(gaps) > 0:
        return middle <= before and middle <= after
    return max(gaps) <= 0 and middle >= before and middle >= after


def _extremum(gap: Gap, start: int, end: int, middle: tuple[int, float]) -> tuple[int, float]:
    """Golden section between `start` and `end`: the knot where the gap is nearest to the other sign."""
    side = 1.0 if middle[1] > 0 else -1.0
    best = middle
    while end - start > _NEAREST_NS:
        low = start + int(_GOLDEN * (end - start))
        high = end - (low - start)
        g_low, g_high = gap(low), gap(high)
        best = min(best, (low, g_low), (high, g_high), key=lambda knot: side * knot[1])
        if side * best[1] <= 0:
            break
        start, end = (start, high) if side * g_low < side * g_high else (low, end)
    return best


def _root(gap: Gap, before: int, after: int, closed_after: bool) -> int:
    while after - before > 1:
        middle = (before + after) // 2
        if (gap(middle) <= 0) == closed_after:
            after = middle
        else:
            before = middle
    return after
