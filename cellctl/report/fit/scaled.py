"""Whether residuals are as large as predicted: residuals in their predicted standard deviations, and coverage."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cellctl.kinematics import Floats
from cellctl.report.drawing import ACCENT, HELD_OUT, INK, svg_of
from cellctl.report.fit.residuals import Residuals

_MANY = 500
"""Number of values from which the histogram has narrow bins."""


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


def _shares(axes: Axes, rows: Residuals, fit: Floats) -> None:
    from scipy.stats import norm

    axes.plot([0, 100], [0, 100], color=INK, linewidth=0.6)
    predicted = np.linspace(0.0, 1.0, 101)
    for label, p_value, colour in (
        ("numbers of the fit", 2.0 * norm.sf(np.abs(fit)), ACCENT),
        ("held-out rows", rows.p_value[np.isfinite(rows.p_value)], HELD_OUT),
    ):
        if p_value.size:
            found = np.searchsorted(np.sort(1.0 - p_value), predicted, side="right") / p_value.size
            axes.plot(100.0 * predicted, 100.0 * found, color=colour, linewidth=1.4, label=label)
    axes.axvline(95.0, color="#bbbbbb", linewidth=0.6, linestyle="--")
    axes.set(xlabel="region predicted to hold, %", ylabel="found to hold, %", xlim=(0, 100), ylim=(0, 101))
    axes.legend(loc="upper left", fontsize=6.5)


def coverage(rows: Residuals) -> tuple[float | None, float | None]:
    """Share of the fit's numbers within ±1.96 σ, and of held-out rows in their 95 % region; None without any."""
    fit, _ = scaled_numbers(rows)
    p_value = rows.p_value[np.isfinite(rows.p_value)]
    return (
        float(np.mean(np.abs(fit) <= 1.96)) if fit.size else None,
        float(np.mean(p_value >= 0.05)) if p_value.size else None,
    )
