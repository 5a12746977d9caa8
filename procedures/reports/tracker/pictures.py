"""Pictures of a tracker campaign: held-out targets one by one, where they are, and the nests over the run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from cellctl.kinematics import Bools, Floats
from cellctl.report.drawing import ACCENT, BEFORE, HELD_OUT, INK, millimetres, svg_of
from procedures.steps.tracker.rows import MonumentsRow, NestRow, ReturnRow


def bars_picture(numbers: Sequence[int], before: Floats, after: Floats, sigma: Floats, late: Bools) -> str:
    """3-D errors (N,), mm, of each target before and after, with the predicted 1 σ after; late: of the late block."""

    def draw(figure: Figure) -> None:
        axes, at = figure.subplots(), np.arange(len(numbers))
        axes.bar(at, before, 0.8, color=BEFORE, alpha=0.45, label="before, nominal joints")
        axes.bar(at, after, 0.5, color=ACCENT, label="after, table in force")
        axes.plot(at, sigma, "_", color=INK, markersize=5, label="predicted 1 σ after")
        if late.any():
            first = int(np.flatnonzero(late)[0]) - 0.5
            axes.axvline(first, color=HELD_OUT, linewidth=1.0)
            axes.text(first + 0.2, 0.97, "late block", color=HELD_OUT, transform=axes.get_xaxis_transform(), va="top")
        axes.set_yscale("log")
        millimetres(axes, "y")
        every = max(1, len(numbers) // 15)
        axes.set_xticks(at[::every], [str(number) for number in numbers[::every]])
        axes.set(xlabel="held-out pose, by its number in the plan", ylabel="position error, mm", xlim=(-0.7, len(at)))
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
        axes.grid(axis="x", visible=False)

    return svg_of(draw, "target-bars", 2.4, "Position error of each held-out target, before and after")


def arrows_picture(places: Floats, before: Floats, after: Floats) -> str:
    """Errors (N, 3), mm, as arrows at places (N, 3), mm, of the robot's base frame, seen from above and from a side."""

    def draw(figure: Figure) -> None:
        pair = figure.subplots(1, 2)
        for axes, (a, b), names in zip(pair, ((0, 1), (0, 2)), ("XY", "XZ"), strict=True):
            longest = float(np.linalg.norm(before, axis=1).max())
            scale = longest / (0.15 * max(float(np.ptp(places[:, a])), 1.0))
            for errors, colour, label in ((before, BEFORE, "before"), (after, ACCENT, "after")):
                axes.quiver(
                    places[:, a], places[:, b], errors[:, a], errors[:, b],
                    angles="xy", scale_units="xy", scale=scale, color=colour, width=0.004, label=label,
                )  # fmt: skip
            axes.set_aspect("equal", adjustable="datalim")
            axes.set(xlabel=f"{names[0]} of the base, mm", ylabel=f"{names[1]} of the base, mm")
        pair[0].legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
        pair[1].set_title(f"longest arrow {longest:.2f} mm", loc="left")

    return svg_of(draw, "target-arrows", 3.0, "Errors of the held-out targets as arrows, before and after")


def nests_picture(nests: Sequence[NestRow], visits: Sequence[MonumentsRow], returns: Sequence[ReturnRow]) -> str:
    """Displacement of each nest, and of the return pose, since the first visit, over the run."""
    began = min([row.point.time_ns for row in nests] + [row.point.time_ns for row in returns])

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for name, marker in zip(dict.fromkeys(row.nest for row in nests), "osD^vP*X", strict=False):
            mine = [row for row in nests if row.nest == name]
            axes.plot(*_shifts(mine, began), f"{marker}-", markersize=4, linewidth=0.8, label=name)
        if returns:
            axes.plot(*_shifts(returns, began), "x--", color=INK, markersize=5, linewidth=0.8, label="return pose")
        for visit in visits:
            if visit.verdict != "still":
                at = max(row.point.time_ns for row in nests if row.visit == visit.visit)
                axes.axvline((at - began) / 60e9, color=HELD_OUT, linewidth=1.0)
        axes.set(xlabel="time, min", ylabel="displacement, mm")
        axes.set_ylim(bottom=0.0)
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))

    return svg_of(draw, "nests", 2.1, "Displacement of the nests and of the return pose over the run")


def _shifts(rows: Sequence[NestRow] | Sequence[ReturnRow], began: int) -> tuple[Floats, Floats]:
    """Minutes since the run began, and distance from the first place, mm."""
    places = np.array([row.point.xyz for row in rows])
    minutes = (np.array([row.point.time_ns for row in rows]) - began) / 60e9
    return minutes, np.linalg.norm(places - places[0], axis=1)
