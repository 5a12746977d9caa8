"""Trends of many points: means of bins with their standard errors, and fewer points to draw."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from cellctl.kinematics import Floats
from cellctl.report.drawing import INK

_FEWEST, _MOST_BINS, _EACH = 4, 24, 8


def bins_of(x: Floats) -> Any:
    """The bin (N,) of each x (N,), all equally wide; more bins for more rows."""
    bins = int(np.clip(len(x) // _EACH, 1, _MOST_BINS))
    width = max(float(np.ptp(x)), 1e-12) / bins
    return np.minimum(((x - x.min()) / width).astype(int), bins - 1)


def binned(x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
    """Means of x and y (N,) in bins, and the standard error of y's: (B,) each; NaN if a bin has too few rows."""
    if len(x) < 2 * _EACH:
        return np.zeros(0), np.zeros(0), np.zeros(0)
    own = bins_of(x)
    count = np.bincount(own)
    enough = np.where(count >= _FEWEST, count, np.nan)
    at, mean = np.bincount(own, x) / enough, np.bincount(own, y) / enough
    spread = np.bincount(own, (y - mean[own]) ** 2, len(count)) / (enough - 1.0)
    return at, mean, np.sqrt(spread / enough)


def draw_trend(axes: Axes, x: Floats, y: Floats, colour: str = INK) -> None:
    """The means of bins as a line, with two standard errors about it."""
    at, mean, error = binned(x, y)
    if at.size:
        axes.fill_between(at, mean - 2.0 * error, mean + 2.0 * error, color=colour, alpha=0.18, linewidth=0)
        axes.plot(at, mean, color=colour, linewidth=1.1)


def dots(count: int) -> dict[str, Any]:
    """Style for `count` points: fewer points are drawn larger."""
    return {"markersize": 3.0 if count < 150 else 2.2 if count < 500 else 1.6, "alpha": 0.75, "markeredgewidth": 0}


def thinned(sizes: Floats, most: int) -> Any:
    """Indices of at most `most` rows, in order: a tenth of them the largest by `sizes` (N,), others evenly."""
    if len(sizes) <= most:
        return np.arange(len(sizes))
    largest = np.argsort(sizes, kind="stable")[-(most // 10) :]
    others = np.setdiff1d(np.arange(len(sizes)), largest)
    evenly = others[np.linspace(0, len(others) - 1, most - len(largest)).astype(int)]
    return np.sort(np.concatenate([largest, evenly]))
