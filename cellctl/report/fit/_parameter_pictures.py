"""Pictures of what a fit determines: correlations of its parameters, σ of the TCP over the joints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path

from cellctl.kinematics import Floats
from cellctl.report.drawing import ACCENT, DIVERGING, FAINT, svg_of
from cellctl.report.figures import MINUS

STRONG = 0.9
"""Least correlation of a listed pair."""

MOST = 50
"""Maximum number of parameters in the picture, the most correlated ones."""

_NAMED = 8
_LEVELS = np.array([0.15, 0.3, 0.5, 0.7, 0.85, 0.95])

Curve = tuple[Floats, Floats]
"""Readings of a joint (S,), deg, and σ there, mm."""

_ABREAST = 7


def strongest(symbols: Sequence[str], matrix: Floats) -> list[str]:
    """The strongly correlated pairs as text, strongest first."""
    first, second = np.triu_indices(len(symbols), 1)
    order = np.argsort(-np.abs(matrix[first, second]), kind="stable")
    pairs = [(first[at], second[at], float(matrix[first[at], second[at]])) for at in order]
    return [_pair(symbols[a], symbols[b], value) for a, b, value in pairs[:_NAMED] if abs(value) >= STRONG]


def count_strong(matrix: Floats) -> int:
    """Number of strongly correlated pairs."""
    return int(np.count_nonzero(np.abs(matrix[np.triu_indices(len(matrix), 1)]) >= STRONG))


def _pair(first: str, second: str, value: float) -> str:
    known = "sum" if value < 0.0 else "difference"
    return f"{first} and {second} ({f'{value:.3f}'.replace('-', MINUS)}: their {known} is known best)"


def correlation_picture(symbols: Sequence[str], matrix: Floats) -> str:
    """The lower triangle as squares; darker: stronger correlation. Red: positive."""
    if len(symbols) > MOST:
        worst = np.sort(np.argsort(-np.max(np.abs(matrix - np.eye(len(matrix))), axis=1), kind="stable")[:MOST])
        symbols, matrix = [symbols[index] for index in worst], matrix[np.ix_(worst, worst)]
    count = len(symbols)

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for level in range(len(_LEVELS)):
            for sign in (-1.0, 1.0):
                _squares(axes, matrix, level, sign)
        axes.set(xlim=(-0.5, count - 0.5), ylim=(count - 0.5, -0.5), aspect="equal")
        small = min(6.5, 260.0 / count)
        axes.set_xticks(range(count), symbols, rotation=90, fontsize=small)
        axes.set_yticks(range(count), symbols, fontsize=small)
        axes.grid(linewidth=0.3)
        axes.legend(loc="upper right", ncols=2, title="correlation", title_fontsize=7, fontsize=6.5)

    return svg_of(draw, "correlation", min(6.6, 2.2 + 0.11 * count), "Correlation of the identified parameters")


def _squares(axes: object, matrix: Floats, level: int, sign: float) -> None:
    """All cells of one sign and level as one path: a picture of thousands of cells stays small."""
    low = _LEVELS[level]
    high = _LEVELS[level + 1] if level + 1 < len(_LEVELS) else np.inf
    rows, columns = np.nonzero(np.tril((sign * matrix >= low) & (sign * matrix < high), -1))
    corners = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5], [-0.5, -0.5]])
    places = np.stack([columns, rows], axis=1)[:, None, :] + corners
    codes = np.tile([Path.MOVETO, *[Path.LINETO] * 3, Path.CLOSEPOLY], len(rows))
    shown = Path(places.reshape(-1, 2), codes) if len(rows) else Path(np.zeros((0, 2)))
    colour = DIVERGING(0.5 + 0.5 * sign * (level + 1.0) / len(_LEVELS))
    words = f"{'+' if sign > 0 else MINUS}{low:.2f} and more"
    axes.add_patch(PathPatch(shown, facecolor=colour, edgecolor="none", label=words))  # type: ignore[attr-defined]


def region_pictures(curves: Sequence[Curve], readings: Floats, joints: Sequence[str]) -> list[str]:
    """σ of points among themselves along each joint; below it a histogram of the fit's `readings` (N, n), deg."""
    groups = [range(start, min(start + _ABREAST, len(joints))) for start in range(0, len(joints), _ABREAST)]
    return [_region_picture(curves, readings, joints, group) for group in groups]


def _region_picture(curves: Sequence[Curve], readings: Floats, joints: Sequence[str], group: range) -> str:
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
