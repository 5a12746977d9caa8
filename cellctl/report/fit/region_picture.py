"""Pictures of σ of the TCP along each joint, inside the measured joint region and outside it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from cellctl.kinematics import Floats
from cellctl.report.drawing import ACCENT, FAINT, svg_of

Curve = tuple[Floats, Floats]
"""Readings of a joint (S,), deg, and σ there, mm."""

_ABREAST = 7


def region_pictures(curves: Sequence[Curve], readings: Floats, joints: Sequence[str]) -> list[str]:
    """σ of points among themselves along each joint; below it a histogram of the fit's `readings` (N, n), deg."""
    groups = [range(start, min(start + _ABREAST, len(joints))) for start in range(0, len(joints), _ABREAST)]
    return [_picture(curves, readings, joints, group) for group in groups]


def _picture(curves: Sequence[Curve], readings: Floats, joints: Sequence[str], group: range) -> str:
    highest = max(float(np.max(curves[joint][1])) for joint in group) or 1.0

    def draw(figure: Figure) -> None:
        grid = figure.subplots(1, len(group), sharey=True, squeeze=False).ravel().tolist()
        for axes, joint in zip(grid, group, strict=True):
            at, sigma = curves[joint]
            counts, edges = np.histogram(readings[:, joint], 24, (float(np.min(at)), float(np.max(at))))
            axes.stairs(0.3 * highest * counts / max(int(counts.max()), 1), edges, fill=True, color=FAINT)
            axes.plot(at, sigma, color=ACCENT, linewidth=1.4)
            axes.set(xlabel=f"{joints[joint]}, °", ylim=(0.0, 1.08 * highest))
        grid[0].set_ylabel("1 σ, mm")

    return svg_of(draw, f"region{group[0]}", 1.8, "Predicted standard deviation of the TCP along each joint")
