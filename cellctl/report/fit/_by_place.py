"""Residuals by place: three views of the volume for points, a map for each touched sphere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, final

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cellctl.kinematics import Bools, Floats
from cellctl.report.drawing import DIVERGING, FAINT, INK, WIDTH, svg_of
from cellctl.report.fit.residuals import Residuals

_COLUMNS = 4


@final
@dataclass(frozen=True, eq=False)
class SphereErrors:
    """N touches: sphere (N,), whether held out (N,), unit normal (N, 3) from the centre to the tip, base frame.

    before, after (N,): signed distance to the surface, mm, positive outside, by the nominal and the identified robot.
    """

    spheres: Sequence[str]
    held_out: Bools
    normals: Floats
    before: Floats
    after: Floats


def sphere_maps(errors: SphereErrors) -> str:
    """Each sphere seen from above (equal-area), each touch coloured by its signed residual.

    Before is above after; with one sphere, beside it.
    """
    spheres = sorted(set(errors.spheres))
    columns = min(len(spheres), _COLUMNS)
    rows = -(-len(spheres) // columns)

    def draw(figure: Figure) -> None:
        places = figure.subplots(*((2 * rows, columns) if len(spheres) > 1 else (1, 2)), squeeze=False).ravel().tolist()
        half = len(places) // 2
        _maps(figure, places[:half], errors, spheres, "before", errors.before)
        _maps(figure, places[half:], errors, spheres, "after", errors.after)

    height = 2 * rows * min(2.4, (WIDTH - 0.8) / columns) if len(spheres) > 1 else 2.7
    return svg_of(draw, "maps", height, "Residual of every touch on a map of each sphere, before and after")


def _maps(
    figure: Figure, places: Sequence[Axes], errors: SphereErrors, spheres: list[str], label: str, values: Floats
) -> None:
    limit = float(np.abs(values).max()) or 1.0
    reach = max(1.0, float(_radius(errors.normals[:, 2]).max())) * 1.06
    for axes, sphere in zip(places, spheres, strict=False):
        _globe(axes, reach)
        axes.set_title(f"{sphere}, {label}")
        mine = np.array([name == sphere for name in errors.spheres])
        for which, marker, size in ((mine & ~errors.held_out, "o", 22), (mine & errors.held_out, "D", 26)):
            x, y = _flat(errors.normals[which])
            dots = axes.scatter(x, y, size, values[which], marker=marker, cmap=DIVERGING, vmin=-limit, vmax=limit)
            dots.set(edgecolor=INK, linewidth=0.4)
    for axes in places[len(spheres) :]:
        axes.set_axis_off()
    figure.colorbar(dots, ax=list(places), label="residual, mm", shrink=0.85, aspect=18)


def _globe(axes: Axes, reach: float) -> None:
    """The net of a sphere seen from above: circles each 30° from the top, the equator bolder; x to the right."""
    turn = np.linspace(0.0, 2.0 * np.pi, 91)
    for degrees in (30, 60, 90):
        radius = float(_radius(np.cos(np.deg2rad([degrees])))[0])
        axes.plot(radius * np.cos(turn), radius * np.sin(turn), color=INK if degrees == 90 else FAINT, linewidth=0.6)
        axes.text(radius * 0.707, -radius * 0.707, f"{degrees}°", fontsize=5.5, color="#777777", va="top")
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", xticks=[], yticks=[])
    axes.grid(visible=False)
    for spine in axes.spines.values():
        spine.set_visible(False)
    axes.text(reach, 0.0, "x", fontsize=6.5, color="#777777", ha="right", va="center")
    axes.text(0.0, reach, "y", fontsize=6.5, color="#777777", ha="center", va="top")


def _radius(up: Floats) -> Floats:
    """Lambert's equal-area radius, 1 at the equator, of unit vectors whose z is `up`."""
    return np.asarray(np.sqrt(np.maximum(1.0 - up, 0.0)))


def _flat(normals: Floats) -> tuple[Floats, Floats]:
    """Unit vectors (N, 3) on the map: x, y."""
    around = np.arctan2(normals[:, 1], normals[:, 0])
    radius = _radius(normals[:, 2])
    return radius * np.cos(around), radius * np.sin(around)


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
