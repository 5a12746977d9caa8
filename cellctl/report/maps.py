"""Maps of spheres: the place and residual of each touch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cellctl.kinematics import Bools, Floats
from cellctl.report.drawing import DIVERGING, FAINT, INK, WIDTH, svg_of

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
