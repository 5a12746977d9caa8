"""Residuals against each joint: a pattern is an error of that joint that the model does not include."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cellctl.kinematics import Bools, Floats
from cellctl.report.drawing import ACCENT, BEFORE, HELD_OUT, INK, svg_of
from cellctl.report.fit.residuals import Residuals
from cellctl.report.fit.trends import bins_of, dots, draw_trend, thinned

ABREAST = 7
"""Number of joints side by side; further joints get another picture."""

_DRAWN = 350
_ENOUGH = 30
_CHANCE = 1e-3
"""A pattern counts below this p-value: one joint in a thousand by random scatter."""


def joint_pictures(rows: Residuals, joints: Sequence[str]) -> list[str]:
    """Residuals along each joint's motion over its reading, before above after. Outliers are not drawn."""
    groups = [range(start, min(start + ABREAST, len(joints))) for start in range(0, len(joints), ABREAST)]
    return [_picture(rows.pick(~rows.outlier), joints, group) for group in groups]


def _picture(rows: Residuals, joints: Sequence[str], group: range) -> str:
    def draw(figure: Figure) -> None:
        grid = figure.subplots(2, len(group), sharex="col", sharey="row", squeeze=False)
        for row, values, label, colour in zip(
            grid, (rows.joint_before, rows.joint_after), ("before", "after"), (BEFORE, ACCENT), strict=True
        ):
            greatest = 0.0
            for axes, joint in zip(row, group, strict=True):
                _panel(axes, rows.readings[:, joint], values[:, joint], rows.held_out, colour)
                greatest = max(greatest, float(np.abs(values[:, joint]).max(initial=0.0)))
            row[0].set_ylabel(f"{label}, mm")
            row[0].set_ylim(-1.08 * (greatest or 1e-3), 1.08 * (greatest or 1e-3))
        for axes, joint in zip(grid[1], group, strict=True):
            axes.set_xlabel(f"{joints[joint]}, °")

    return svg_of(draw, f"joints{group.start}", 3.0, "Residual of every row against each joint, before and after")


def _panel(axes: Axes, readings: Floats, values: Floats, held_out: Bools, colour: str) -> None:
    axes.axhline(0.0, color=INK, linewidth=0.6)
    for mine, marker, look in ((~held_out, "o", colour), (held_out, "D", HELD_OUT)):
        if mine.any():
            shown = np.flatnonzero(mine)[thinned(np.abs(values[mine]), _DRAWN // (2 if held_out.any() else 1))]
            axes.plot(readings[shown], values[shown], marker, color=look, **dots(len(values)))
    draw_trend(axes, readings, values)


def explained(rows: Residuals) -> list[tuple[int, float, float]]:
    """Joints whose angle significantly explains residuals along their motion, for any pattern.

    For each: number from 0, share of the variance (less that of random scatter), and RMS of the pattern, mm; the
    largest share first. Outliers are not counted.
    """
    counted = ~rows.outlier
    if counted.sum() < _ENOUGH:
        return []
    readings, left = rows.readings[counted], rows.joint_after[counted]
    found = [(joint, *_pattern(readings[:, joint], left[:, joint])) for joint in range(readings.shape[1])]
    kept = [(joint, share, size) for joint, share, size, p_value in found if p_value < _CHANCE / readings.shape[1]]
    return sorted(kept, key=lambda each: -each[1])


def _pattern(readings: Floats, values: Floats) -> tuple[float, float, float]:
    """The variance of `values` (N,) between bins of `readings` (N,): share, RMS, p-value.

    Analysis of variance; random scatter adds (B − 1) times the variance within the B bins.
    """
    from scipy.stats import f

    _, own = np.unique(bins_of(readings), return_inverse=True)
    count, whole = np.bincount(own), float(np.sum((values - values.mean()) ** 2))
    within = float(np.sum((values - (np.bincount(own, values) / count)[own]) ** 2))
    between, free = len(count) - 1, len(values) - len(count)
    if between < 1 or free < 1 or whole <= 0.0:
        return 0.0, 0.0, 1.0
    noise = within / free
    share = max((whole - within - between * noise) / whole, 0.0)
    p_value = float(f.sf((whole - within) / between / max(noise, 1e-300), between, free))
    return share, float(np.sqrt(share * whole / len(values))), p_value
