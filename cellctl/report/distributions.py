"""Pictures of a set of errors, before and after: histogram and cumulative curve; targets one by one with their σ."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from cellctl.kinematics import Floats
from cellctl.report.drawing import ACCENT, BEFORE, INK, millimetres, svg_of

Sets: TypeAlias = list[tuple[str, Floats, str, str]]
"""Label, errors (N,), mm, colour, hatch."""

_LEAST_MM = 1e-3
"""Smaller errors are drawn at this value, mm: a logarithmic axis has no zero, and touches do not resolve 1 µm."""


def before_and_after(name: str, before: Floats, after: Floats, what: str) -> str:
    """Histogram and cumulative curve of |errors| (N,), mm, on one logarithmic axis."""
    sets = [("before", before, BEFORE, ""), ("after", after, ACCENT, "////")]
    shown: Sets = [(label, np.maximum(np.abs(e), _LEAST_MM), *look) for label, e, *look in sets if e.size]

    def draw(figure: Figure) -> None:
        counts, cumulative = figure.subplots(1, 2, sharex=True)
        _histogram(counts, shown, what)
        _cumulative(cumulative, shown, what)

    return svg_of(draw, name, 2.3, f"Histogram and cumulative curve of {what}, before and after")


def one_by_one(name: str, numbers: Floats, errors: Floats, sigma: Floats, what: str) -> str:
    """Signed errors (N,), mm, over their number, each with its predicted 1 σ (N,)."""

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        axes.axhline(0.0, color=INK, linewidth=0.6)
        axes.errorbar(numbers, errors, sigma, fmt="o", color=ACCENT, markersize=3, elinewidth=0.8)
        axes.set(xlabel="target", ylabel=f"{what}, mm")
        axes.set_title("after, one by one, with predicted 1 σ", loc="left")

    return svg_of(draw, name, 1.9, f"{what} of each target with its predicted standard deviation")


def _histogram(axes: Axes, sets: Sets, what: str) -> None:
    everything = np.concatenate([errors for _, errors, *_ in sets])
    lower, upper = np.floor(np.log10(everything.min()) * 4) / 4, np.ceil(np.log10(everything.max()) * 4) / 4
    edges = (10.0 ** np.arange(lower, max(upper, lower + 0.25) + 0.01, 0.125)).tolist()
    for label, errors, colour, hatch in sets:
        axes.hist(errors, edges, color=colour, alpha=0.75, label=label, hatch=hatch, edgecolor="white", linewidth=0.4)
    axes.set_xscale("log")
    millimetres(axes)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel=f"{what}, mm", ylabel="count")
    axes.legend(loc="upper center", ncols=2, bbox_to_anchor=(0.5, 1.16))


def _cumulative(axes: Axes, sets: Sets, what: str) -> None:
    highest = max(float(np.median(errors)) for _, errors, *_ in sets)
    for label, errors, colour, _ in sets:
        steps = np.arange(len(errors) + 1) / len(errors) * 100.0
        at, median = np.concatenate([[errors.min()], np.sort(errors)]), float(np.median(errors))
        axes.step(at, steps, where="post", color=colour, linewidth=1.6, label=label)
        axes.plot(median, 50.0, "o", color=colour, markersize=4)
        aside: dict[str, Any] = {"xytext": (-6, 0), "ha": "right"}
        if len(sets) > 1 and median == highest:
            aside = {"xytext": (6, 0), "ha": "left"}
        place = {**aside, "textcoords": "offset points", "va": "center"}
        axes.annotate(f"median {median:.3f}", (median, 50.0), fontsize=7, color=INK, **place)
    axes.set_xscale("log")
    millimetres(axes)
    axes.set(xlabel=f"{what}, mm", ylabel="share not above, %", ylim=(0, 102))
    axes.axhline(95.0, color="#bbbbbb", linewidth=0.6, linestyle="--")
    axes.text(0.01, 94.0, "95 %", fontsize=6.5, va="top", transform=axes.get_yaxis_transform(), color="#666666")
