"""Pictures of what changed in the course of a run: the reference touches, the stops."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from cellctl.kinematics import Bools, Floats
from cellctl.report.drawing import ACCENT, INK, svg_of

Rows = Sequence[Mapping[str, Any]]


def reference_touches(rows: Rows, drift: Mapping[str, Any]) -> str:
    """The shift of the reference touch along its normal over the run, with 1 σ, and the drift where it was modelled."""
    slope, first = float(drift.get("mm_per_touch") or 0.0), float(rows[0].get("repeats") or 0.0)

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        axes.axhline(0.0, color=INK, linewidth=0.6)
        looks = _looks(rows)
        for (sphere, at, shift, sigma), marker in zip(looks, "osD^v" * len(looks), strict=False):
            axes.errorbar(at, shift, sigma, fmt=f"{marker}-", color=ACCENT, markersize=4, linewidth=0.8, label=sphere)
        if drift.get("modelled"):
            ends = np.array([first, max(_made_before(row) for row in rows)])
            axes.plot(ends, slope * (ends - first), "--", color=INK, linewidth=1.0, label="drift, modelled")
        axes.set(xlabel="contacts made before", ylabel="shift along the normal, mm")
        axes.legend(loc="best")

    return svg_of(draw, "reference", 1.9, "Shift of the reference touch in the course of the run")


def over_travel(travel: Floats, faulty: Bools) -> str:
    """The tip's way from contact to rest (N,), mm, touch by touch; crossed where telegrams went wrong (N,)."""
    at = np.arange(1, len(travel) + 1)

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        axes.plot(at, travel, "o", color=ACCENT, markersize=2.5)
        if faulty.any():
            axes.plot(at[faulty], travel[faulty], "x", color=INK, markersize=7, label="late, lost or skipped telegrams")
            axes.legend(loc="best")
        axes.set(xlabel="touch, in the order of the run", ylabel="over-travel, mm")
        axes.set_ylim(0.0, 1.15 * float(travel.max()) or 1.0)

    return svg_of(draw, "stops", 1.6, "Over-travel of the tip after contact, touch by touch")


def _looks(rows: Rows) -> list[tuple[str, list[float], list[float], list[float]]]:
    series = []
    for sphere in dict.fromkeys(str(row.get("sphere", "")) for row in rows):
        mine = [row for row in rows if str(row.get("sphere", "")) == sphere and row.get("shift_mm") is not None]
        shift, sigma = ([float(row.get(name) or 0.0) for row in mine] for name in ("shift_mm", "sigma_mm"))
        series.append((sphere, [_made_before(row) for row in mine], shift, sigma))
    return series


def _made_before(row: Mapping[str, Any]) -> float:
    """How many contacts were made before a visit: its own number, stand-offs counted; else the last touch's."""
    return float(row.get("number", row.get("after_touch")) or 0.0)
