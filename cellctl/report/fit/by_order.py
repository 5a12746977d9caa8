"""Residuals in the order in which the rows stand in the data set: warming, a knock, a loose target."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cellctl.kinematics import Bools, Floats
from cellctl.report.drawing import ACCENT, HELD_OUT, INK, svg_of
from cellctl.report.fit.residuals import Residuals
from cellctl.report.fit.trends import dots, draw_trend, thinned

_DRAWN = 500
_ENOUGH = 20
_CLEAR = 4.0
"""A slope counts from this many of its standard errors."""


def order_picture(rows: Residuals, order: Floats, sessions: Sequence[str]) -> str:
    """Residuals by coordinate over the place (N,) of each row; sessions: names by number."""
    series = series_of(rows)

    def draw(figure: Figure) -> None:
        grid = figure.subplots(len(series), 1, sharex=True, squeeze=False).ravel().tolist()
        for axes, (label, values) in zip(grid, series, strict=True):
            _panel(axes, order, values, rows.held_out, rows.outlier)
            axes.set_ylabel(label)
        _mark_sessions(grid, order, rows.session, sessions)
        grid[-1].set_xlabel("line of the data set")

    return svg_of(draw, "order", 0.35 + 0.95 * len(series), "What is left of each row in the order of the data set")


def series_of(rows: Residuals) -> list[tuple[str, Floats]]:
    """Label and values (N,) after, NaN if a row has none: X, Y, Z of points, distances, turns."""
    series, vectors = [], ~rows.distances
    if vectors.any():
        series += [
            (f"{axis}, mm", np.where(vectors, rows.after[:, number], np.nan)) for number, axis in enumerate("XYZ")
        ]
    if rows.distances.any():
        series.append(("distance, mm", rows.signed_after))
    turned = np.rad2deg(np.linalg.norm(rows.turn, axis=1))
    return series + ([("turn, °", turned)] if np.isfinite(turned).any() else [])


def drifts(rows: Residuals, order: Floats) -> list[tuple[str, float, float]]:
    """Significant drifts over the rows: label, change from first row to last, its standard error.

    Over the rows within each session, less the session's mean: sessions may differ for other reasons.
    """
    counted, found = ~rows.outlier, []
    for label, values in series_of(rows):
        if label.startswith("turn"):
            continue
        mine = counted & np.isfinite(values)
        if mine.sum() < _ENOUGH:
            continue
        x, y = _centred(order[mine], rows.session[mine]), _centred(values[mine], rows.session[mine])
        spread = float(x @ x)
        slope = float(x @ y) / spread if spread > 0.0 else 0.0
        error = float(np.sqrt(np.sum((y - slope * x) ** 2) / max(len(x) - 2, 1) / max(spread, 1e-300)))
        if abs(slope) > _CLEAR * error:
            length = float(np.ptp(order[mine]))
            found.append((label.partition(",")[0], slope * length, error * length))
    return found


def _centred(values: Floats, groups: Floats) -> Floats:
    result = values.astype(float)
    for group in np.unique(groups):
        result[groups == group] -= result[groups == group].mean()
    return result


def _panel(axes: Axes, order: Floats, values: Floats, held_out: Bools, outlying: Bools) -> None:
    axes.axhline(0.0, color=INK, linewidth=0.6)
    there = np.isfinite(values)
    for mine, marker, colour in ((~held_out, "o", ACCENT), (held_out, "D", HELD_OUT)):
        chosen = np.flatnonzero(mine & there & ~outlying)
        shown = chosen[thinned(np.abs(values[chosen]), _DRAWN)]
        axes.plot(order[shown], values[shown], marker, color=colour, **dots(int(there.sum())))
    draw_trend(axes, order[there & ~outlying], values[there & ~outlying])


def _mark_sessions(grid: list[Axes], order: Floats, session: Floats, names: Sequence[str]) -> None:
    numbers = np.unique(session)
    if len(numbers) < 2:
        return
    for number in numbers:
        first = float(order[session == number].min())
        for axes in grid:
            axes.axvline(first, color="#999999", linewidth=0.7, linestyle=":")
        place = grid[0].get_xaxis_transform()
        grid[0].text(first, 1.02, names[int(number)], fontsize=6.5, color="#555555", transform=place)
