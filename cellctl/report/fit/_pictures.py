"""Pictures of a fit: residuals by joint, by row and in predicted σ; correlations of parameters; σ over the joints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path

from cellctl.calibration.distributions import f_sf, normal_sf
from cellctl.kinematics import Bools, Floats
from cellctl.report.drawing import ACCENT, BEFORE, DIVERGING, FAINT, HELD_OUT, INK, svg_of
from cellctl.report.figures import MINUS
from cellctl.report.fit.residuals import Residuals

_FEWEST, _MOST_BINS, _EACH = 4, 24, 8

ABREAST = 7
"""Number of joints side by side; further joints get another picture."""

_DRAWN_BY_JOINT = 350
_ENOUGH_BY_JOINT = 30
_CHANCE = 1e-3
"""A pattern counts below this p-value: one joint in a thousand by random scatter."""

_DRAWN_BY_ORDER = 500
_ENOUGH_BY_ORDER = 20
_CLEAR = 4.0
"""A slope counts from this many of its standard errors."""

_MANY = 500
"""Number of values from which the histogram has narrow bins."""


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


def name_and_unit(joint: str) -> tuple[str, str]:
    """Of an element of `FitStory.joints`, which has the unit of prismatic joints only: A1, mm; A2, °."""
    name, prismatic, _ = joint.partition(" (mm)")
    return name, "mm" if prismatic else "°"


def axis_label(joint: str) -> str:
    """A joint's name with the unit of its reading, as `A1, mm`."""
    return ", ".join(name_and_unit(joint))


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
                _joint_panel(axes, rows.readings[:, joint], values[:, joint], rows.held_out, colour)
                greatest = max(greatest, float(np.abs(values[:, joint]).max(initial=0.0)))
            row[0].set_ylabel(f"{label}, mm")
            row[0].set_ylim(-1.08 * (greatest or 1e-3), 1.08 * (greatest or 1e-3))
        for axes, joint in zip(grid[1], group, strict=True):
            axes.set_xlabel(axis_label(joints[joint]))

    return svg_of(draw, f"joints{group.start}", 3.0, "Residual of every row against each joint, before and after")


def _joint_panel(axes: Axes, readings: Floats, values: Floats, held_out: Bools, colour: str) -> None:
    axes.axhline(0.0, color=INK, linewidth=0.6)
    for mine, marker, look in ((~held_out, "o", colour), (held_out, "D", HELD_OUT)):
        if mine.any():
            shown = np.flatnonzero(mine)[thinned(np.abs(values[mine]), _DRAWN_BY_JOINT // (2 if held_out.any() else 1))]
            axes.plot(readings[shown], values[shown], marker, color=look, **dots(len(values)))
    draw_trend(axes, readings, values)


def explained(rows: Residuals) -> list[tuple[int, float, float]]:
    """Joints whose angle significantly explains residuals along their motion, for any pattern.

    For each: number from 0, share of the variance (less that of random scatter), and RMS of the pattern, mm; the
    largest share first. Outliers are not counted.
    """
    counted = ~rows.outlier
    if counted.sum() < _ENOUGH_BY_JOINT:
        return []
    readings, left = rows.readings[counted], rows.joint_after[counted]
    found = [(joint, *_pattern(readings[:, joint], left[:, joint])) for joint in range(readings.shape[1])]
    kept = [(joint, share, size) for joint, share, size, p_value in found if p_value < _CHANCE / readings.shape[1]]
    return sorted(kept, key=lambda each: -each[1])


def _pattern(readings: Floats, values: Floats) -> tuple[float, float, float]:
    """The variance of `values` (N,) between bins of `readings` (N,): share, RMS, p-value.

    Analysis of variance; random scatter adds (B − 1) times the variance within the B bins.
    """
    _, own = np.unique(bins_of(readings), return_inverse=True)
    count, whole = np.bincount(own), float(np.sum((values - values.mean()) ** 2))
    within = float(np.sum((values - (np.bincount(own, values) / count)[own]) ** 2))
    between, free = len(count) - 1, len(values) - len(count)
    if between < 1 or free < 1 or whole <= 0.0:
        return 0.0, 0.0, 1.0
    noise = within / free
    share = max((whole - within - between * noise) / whole, 0.0)
    p_value = float(f_sf((whole - within) / between / max(noise, 1e-300), between, free))
    return share, float(np.sqrt(share * whole / len(values))), p_value


def order_picture(rows: Residuals, order: Floats, sessions: Sequence[str]) -> str:
    """Residuals by coordinate over the place (N,) of each row; sessions: names by number."""
    series = series_of(rows)

    def draw(figure: Figure) -> None:
        grid = figure.subplots(len(series), 1, sharex=True, squeeze=False).ravel().tolist()
        for axes, (label, values) in zip(grid, series, strict=True):
            _order_panel(axes, order, values, rows.held_out, rows.outlier)
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
        if mine.sum() < _ENOUGH_BY_ORDER:
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


def _order_panel(axes: Axes, order: Floats, values: Floats, held_out: Bools, outlying: Bools) -> None:
    axes.axhline(0.0, color=INK, linewidth=0.6)
    there = np.isfinite(values)
    for mine, marker, colour in ((~held_out, "o", ACCENT), (held_out, "D", HELD_OUT)):
        chosen = np.flatnonzero(mine & there & ~outlying)
        shown = chosen[thinned(np.abs(values[chosen]), _DRAWN_BY_ORDER)]
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


def scaled_numbers(rows: Residuals) -> tuple[Floats, Floats]:
    """The numbers of the fit's rows and of the held-out ones (M,), in their predicted standard deviations."""
    parts = (rows.scaled[rows.fitted], rows.scaled[rows.held_out])
    return tuple(part[np.isfinite(part)] for part in parts)  # type: ignore[return-value]  # there are two


def scaled_picture(rows: Residuals) -> str:
    """Histogram of the scaled numbers against the normal curve; observed against predicted shares."""
    fit, held_out = scaled_numbers(rows)

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2)
        _histogram(left, [("fit", fit, ACCENT), ("held out", held_out, HELD_OUT)])
        _shares(right, rows, fit)

    return svg_of(
        draw, "scaled", 2.3, "Residuals in their predicted standard deviations, and how many lie where predicted"
    )


def _histogram(axes: Axes, sets: list[tuple[str, Floats, str]]) -> None:
    at = np.linspace(-4.0, 4.0, 81)
    axes.plot(at, np.exp(-(at**2) / 2.0) / np.sqrt(2.0 * np.pi), color=INK, linewidth=1.0, label="as predicted")
    for label, values, colour in sets:
        if values.size:
            edges = np.linspace(-4.0, 4.0, 33 if values.size >= _MANY else 13)
            clipped = np.clip(values, -3.999, 3.999)
            axes.hist(clipped, edges.tolist(), density=True, histtype="step", color=colour, linewidth=1.2, label=label)
    axes.set(xlabel="residual / predicted σ", ylabel="density", xlim=(-4.0, 4.0))
    axes.legend(loc="upper left", fontsize=6.5)


def _legend(axes: Axes, **how: Any) -> None:
    """A legend if anything has a label: a model that states no σ has no shares."""
    if axes.get_legend_handles_labels()[0]:
        axes.legend(**how)


def _shares(axes: Axes, rows: Residuals, fit: Floats) -> None:
    axes.plot([0, 100], [0, 100], color=INK, linewidth=0.6)
    predicted = np.linspace(0.0, 1.0, 101)
    for label, p_value, colour in (
        ("numbers of the fit", 2.0 * normal_sf(np.abs(fit)), ACCENT),
        ("held-out rows", rows.p_value[np.isfinite(rows.p_value)], HELD_OUT),
    ):
        if p_value.size:
            found = np.searchsorted(np.sort(1.0 - p_value), predicted, side="right") / p_value.size
            axes.plot(100.0 * predicted, 100.0 * found, color=colour, linewidth=1.4, label=label)
    axes.axvline(95.0, color="#bbbbbb", linewidth=0.6, linestyle="--")
    axes.set(xlabel="region predicted to hold, %", ylabel="found to hold, %", xlim=(0, 100), ylim=(0, 101))
    _legend(axes, loc="upper left", fontsize=6.5)


def coverage(rows: Residuals) -> tuple[float | None, float | None]:
    """Share of the fit's numbers within ±1.96 σ, and of held-out rows in their 95 % region; None without any."""
    fit, _ = scaled_numbers(rows)
    p_value = rows.p_value[np.isfinite(rows.p_value)]
    return (
        float(np.mean(np.abs(fit) <= 1.96)) if fit.size else None,
        float(np.mean(p_value >= 0.05)) if p_value.size else None,
    )


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
        _legend(axes, loc="upper right", ncols=2, title="correlation", title_fontsize=7, fontsize=6.5)

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
            axes.set(xlabel=axis_label(joints[joint]), ylim=(0.0, 1.08 * highest))
        grid[0].set_ylabel("1 σ, mm")

    return svg_of(draw, f"region{group[0]}", 1.8, "Predicted standard deviation of the TCP along each joint")
