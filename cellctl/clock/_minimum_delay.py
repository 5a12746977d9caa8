"""Maps a device's clock to the cell's by the messages with the least delay.

A message stamped at device time x arrives at the cell's time x + offset + drift·x + delay with delay ≥ 0: adapters and
schedulers only ever add. The line under all points that lies closest to them (the edge of their lower convex hull below
the mean abscissa, which minimises the summed delay) is the map. Cf. Klipper's clocksync, Moon et al. 1999 (INFOCOM).
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from itertools import pairwise
from typing import final

MAX_DRIFT = 3e-4
"""Largest plausible drift (300 ppm); the fit is limited to it."""

_SHORTEST_SPAN_NS = 500_000_000
"""Below this span the drift is indistinguishable from the delays' scatter, and is taken as zero."""
_ON_THE_LINE = 2
"""This many messages lie on the line for any delays, and carry no information about it."""


@final
@dataclass(frozen=True, slots=True)
class DelayFit:
    """Cell time = device time + offset + drift × (device time − reference); nanoseconds.

    `sigma_ns`: how far the fastest tenth of the messages (three at least) lies above the line, a measure of how well
    the envelope is supported. A constant delay common to all messages is unobservable; it is in the
    offset.
    """

    offset_ns: float
    drift: float
    reference_ns: int
    sigma_ns: float
    count: int

    def to_cell_ns(self, device_ns: int) -> int:
        """The cell's time at which the device's clock showed `device_ns`."""
        return device_ns + round(self.offset_ns + self.drift * (device_ns - self.reference_ns))


@final
class MinimumDelayFit:
    """Collects (device time, arrival) pairs of the last `window_s` seconds and fits their lower envelope."""

    def __init__(self, window_s: float = 20.0) -> None:
        self._window_ns = round(window_s * 1e9)
        self._points: deque[tuple[int, int]] = deque()
        self._fitted: DelayFit | None = None

    def add(self, device_ns: int, arrival_ns: int) -> None:
        """A message stamped `device_ns` by the device arrived at `arrival_ns` of the cell's clock."""
        self._fitted = None
        points = self._points
        points.append((device_ns, arrival_ns - device_ns))
        while points[0][0] < device_ns - self._window_ns:
            points.popleft()

    def clear(self) -> None:
        """Discard all messages: the device's clock restarted."""
        self._fitted = None
        self._points.clear()

    def __len__(self) -> int:
        return len(self._points)

    def fit(self) -> DelayFit:
        """The map from the messages so far. Raises ValueError without messages."""
        if self._fitted is None:
            self._fitted = self._lower_envelope()
        return self._fitted

    def _lower_envelope(self) -> DelayFit:
        if not self._points:
            raise ValueError("no message to fit the device's clock to")
        reference = self._points[0][0]
        points = sorted({x - reference: y for x, y in sorted(self._points, reverse=True)}.items())
        slope = self._slope(points)
        offset = min(y - slope * x for x, y in points)
        above = sorted(y - slope * x - offset for x, y in points)
        tenth = min(max(len(above) // 10, _ON_THE_LINE), len(above) - 1)
        return DelayFit(offset, slope, reference, above[tenth], len(points))

    @staticmethod
    def _slope(points: list[tuple[int, int]]) -> float:
        if points[-1][0] - points[0][0] < _SHORTEST_SPAN_NS:
            return 0.0
        hull: list[tuple[int, int]] = []
        for point in points:
            while len(hull) > 1 and _turns_down(hull[-2], hull[-1], point):
                hull.pop()
            hull.append(point)
        middle = sum(x for x, _ in points) / len(points)
        (x0, y0), (x1, y1) = next((a, b) for a, b in pairwise(hull) if b[0] >= middle)
        return max(-MAX_DRIFT, min(MAX_DRIFT, (y1 - y0) / (x1 - x0)))


def _turns_down(a: tuple[int, int], b: tuple[int, int], c: tuple[int, int]) -> bool:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) <= 0
