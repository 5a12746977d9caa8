"""Residuals by place: three views of the volume for points, a map for each touched sphere."""

from __future__ import annotations

from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cellctl.kinematics import Floats
from cellctl.report.drawing import INK, svg_of
from cellctl.report.fit.residuals import Residuals

SEQUENTIAL = matplotlib.colormaps["YlOrRd"].resampled(24)
EACH = 160
"""Up to this number, each row has its own arrow; with more rows, neighbours share one."""

_CELLS = 11
_ROOM = 4.6
"""Inches for the three views side by side, without their labels."""

_FEWEST = 3
_VIEWS = (("X", "Y"), ("X", "Z"), ("Y", "Z"))


def place_picture(rows: Residuals, places: Floats, errors: Floats) -> str:
    """Errors (N, 3), mm, at `places` (N, 3), mm, in three views: arrows in the plane, colours for their 3-D size.

    With many rows, arrows are the means of cells and colours their root mean squares.
    """
    counted = ~rows.outlier
    places, errors = places[counted], errors[counted]
    views = [_view(places, errors, first, second) for first, second in ((0, 1), (0, 2), (1, 2))]
    longest = max(float(np.linalg.norm(arrows, axis=1).max(initial=0.0)) for _, arrows, _ in views) or 1.0
    greatest = max(float(sizes.max(initial=0.0)) for _, _, sizes in views) or 1.0
    spans = 1.28 * np.maximum(np.ptp(places, axis=0), 0.15 * float(np.ptp(places, axis=0).max()) or 1.0)
    unit = 0.09 * float(spans.max()) / longest
    widths = spans[[0, 0, 1]]
    height = float(np.clip(_ROOM * max(spans[1], spans[2]) / widths.sum(), 1.2, 3.2)) + 0.75

    def draw(figure: Figure) -> None:
        grid = figure.subplots(1, 3, width_ratios=widths.tolist())
        for axes, (at, arrows, sizes), names in zip(grid, views, _VIEWS, strict=True):
            dots = _arrows(axes, at, arrows * unit, sizes, greatest)
            axes.set(xlabel=f"{names[0]}, mm", ylabel=f"{names[1]}, mm", aspect="equal")
            axes.margins(0.14)
            axes.locator_params(nbins=4)
            axes.tick_params(labelsize=6)
        figure.colorbar(dots, ax=list(grid), label="error, mm", shrink=0.8, aspect=22)
        figure.suptitle(f"longest arrow: {longest:.3f} mm", fontsize=7, color="#666666", x=0.02, ha="left")

    return svg_of(draw, "places", height, "Error at each place in three views of the measured volume")


def _view(places: Floats, errors: Floats, first: int, second: int) -> tuple[Floats, Floats, Floats]:
    """Places (M, 2), arrows (M, 2) and sizes (M,) of one view: of the rows themselves, or of cells of them."""
    flat, arrows, squares = places[:, [first, second]], errors[:, [first, second]], np.sum(errors**2, axis=1)
    if len(places) <= EACH:
        return flat, arrows, np.sqrt(squares)
    low, step = flat.min(axis=0), max(float(np.ptp(flat, axis=0).max()), 1e-9) / (_CELLS - 1e-9)
    _, cell, count = np.unique(((flat - low) / step).astype(int), axis=0, return_inverse=True, return_counts=True)
    cell = cell.reshape(-1)
    means = [np.bincount(cell, column) / count for column in (*flat.T, *arrows.T, squares)]
    enough = count >= _FEWEST
    return np.stack(means[:2], 1)[enough], np.stack(means[2:4], 1)[enough], np.sqrt(means[4])[enough]


def _arrows(axes: Axes, at: Floats, arrows: Floats, sizes: Floats, greatest: float) -> Any:
    axes.quiver(
        *at.T, *arrows.T, angles="xy", scale_units="xy", scale=1.0, color=INK, width=0.006, headwidth=3.5, zorder=3
    )
    dots = axes.scatter(at[:, 0], at[:, 1], 16, sizes, cmap=SEQUENTIAL, vmin=0.0, vmax=greatest)
    dots.set(edgecolor="#999999", linewidth=0.3)
    return dots
