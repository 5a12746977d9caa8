"""One sphere as its paper shows it: residuals by iteration, by touch and about the sphere, and their distribution."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cellctl.calibration import ErrorFigures
from cellctl.kinematics import Bools
from cellctl.records import ResidualsRow
from cellctl.report import ACCENT, BEFORE, HELD_OUT, INK, ReportSection, Residuals, Run, fixed, millimetres, svg_of
from procedures.steps.sphere.rows import ConvergenceRow

HELD_OUT_PUBLISHED = (1.923, 4.715), (0.383, 1.153)
SIMULATED_PUBLISHED = (3.657, 5.559), (0.665, 1.104)
"""Mean and largest error before and after, mm: Wang et al. 2024, KUKA KR5 R1400. Of 30 held-out touches (figure 11),
and of its simulation (figure 8)."""

_LEAST_MM = 1e-4
"""Smaller residuals are drawn at this value, mm: a logarithmic axis has no zero."""
_REACH = 0.4
"""The largest residual is drawn so long, in radii of the sphere."""


def build(run: Run) -> Mapping[str, Any] | None:
    """Table and pictures; outliers of the fit are not drawn."""
    row, stored = run.state.last(ConvergenceRow), run.state.last(ResidualsRow)
    if row is None or stored is None:
        return None
    every = Residuals.of_row(stored)
    rows = every.pick((every.fitted | every.held_out) & every.distances)
    return {
        "lines": [
            _line(f"{rows.fitted.sum()} touches of the fit", *_figures(rows, rows.fitted)),
            _line(f"{rows.held_out.sum()} held-out touches", *_figures(rows, rows.held_out)),
            _line("published: 30 held-out touches", *HELD_OUT_PUBLISHED),
            _line("published: simulation", *SIMULATED_PUBLISHED),
        ],
        "iterations": len(row.fit_mean) - 1,
        "convergence": convergence_picture(row),
        "one_by_one": one_by_one_picture(rows),
        "about": about_picture(rows),
    }


def _figures(rows: Residuals, which: Bools) -> tuple[tuple[float, float], tuple[float, float]]:
    """Mean and largest |residual| before and after, mm."""
    found = [ErrorFigures.of(np.abs(values[which])) for values in (rows.signed_before, rows.signed_after)]
    return (found[0].mean, found[0].max), (found[1].mean, found[1].max)


def _line(name: str, before: tuple[float, float], after: tuple[float, float]) -> dict[str, Any]:
    gains = [f"{100.0 * (1.0 - new / old):.1f} %" for old, new in zip(before, after, strict=True)]
    return {
        "name": name,
        "mean": (fixed(before[0]), fixed(after[0]), gains[0]),
        "max": (fixed(before[1]), fixed(after[1]), gains[1]),
    }


def convergence_picture(row: ConvergenceRow) -> str:
    """Mean and largest |residual| at the start and after each iteration."""

    def draw(figure: Figure) -> None:
        axes, at = figure.subplots(), np.arange(len(row.fit_mean))
        for name, mean, most, colour in (
            ("touches of the fit", row.fit_mean, row.fit_max, ACCENT),
            ("held-out touches", row.held_out_mean, row.held_out_max, HELD_OUT),
        ):
            axes.plot(at, mean, "o-", color=colour, markersize=4, linewidth=1.2, label=f"{name}, mean")
            axes.plot(at, most, "^:", color=colour, markersize=4, linewidth=1.0, label=f"{name}, largest")
        axes.set_yscale("log")
        millimetres(axes, "y")
        axes.set_xticks(at)
        axes.set(xlabel="iteration, 0: nominal robot", ylabel="|residual|, mm")
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))

    return svg_of(draw, "convergence", 2.2, "Residual of the touches after each iteration of the fit")


def one_by_one_picture(rows: Residuals) -> str:
    """|residual| of each touch before and after: touches of the fit above the held-out ones."""

    def draw(figure: Figure) -> None:
        above, below = figure.subplots(2, 1, sharey=True)
        for axes, which, name in (
            (above, rows.fitted, "touch of the fit"),
            (below, rows.held_out, "held-out touch"),
        ):
            for label, values, width, colour, alpha in (
                ("before", rows.signed_before, 0.8, BEFORE, 0.45),
                ("after", rows.signed_after, 0.5, ACCENT, 1.0),
            ):
                mine = np.maximum(np.abs(values[which]), _LEAST_MM)
                axes.bar(np.arange(1, len(mine) + 1), mine, width, color=colour, alpha=alpha, label=label)
            axes.set_yscale("log")
            millimetres(axes, "y")
            axes.set(xlabel=f"{name}, in the order of the run", ylabel="|residual|, mm", xlim=(0.2, which.sum() + 0.8))
            axes.grid(axis="x", visible=False)
        published = zip(HELD_OUT_PUBLISHED, (BEFORE, ACCENT), ("before", "after"), strict=True)
        for (mean, _), colour, when in published:
            below.axhline(mean, color=colour, linewidth=0.9, linestyle="--", label=f"published mean {when}")
        handles, labels = below.get_legend_handles_labels()
        figure.legend(
            handles[2:] + handles[:2], labels[2:] + labels[:2], loc="outside upper center", ncols=4, labelcolor=INK
        )

    return svg_of(draw, "touch-bars", 3.6, "Residual of each touch before and after, of the fit and held out")


def about_picture(rows: Residuals) -> str:
    """Left: the touches about the sphere, turned into one meridian; right: the distribution of |residual|."""

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2)
        _meridian(left, rows)
        _boxes(right, rows)

    return svg_of(draw, "about-sphere", 3.1, "Touches about the sphere before and after, and boxes of their residuals")


def _meridian(axes: Axes, rows: Residuals) -> None:
    """Each touch at its height on the sphere, off the surface by its enlarged residual."""
    height = np.arcsin(np.clip(rows.normal[:, 2], -1.0, 1.0))
    greatest = float(np.abs(rows.signed_before).max()) or 1.0
    turn = np.linspace(min(float(height.min()), 0.0) - 0.1, np.pi / 2.0, 181)
    axes.plot(np.cos(turn), np.sin(turn), color=INK, linewidth=0.8, label="surface")
    for label, values, colour in (("before", rows.signed_before, BEFORE), ("after", rows.signed_after, ACCENT)):
        away = 1.0 + _REACH * values / greatest
        for marker, which in (("o", rows.fitted), ("D", rows.held_out)):
            axes.plot(
                (away * np.cos(height))[which],
                (away * np.sin(height))[which],
                marker,
                color=colour,
                markersize=3.2,
                label=label if marker == "o" else None,
            )
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    axes.set_title(f"residuals enlarged: the largest, {greatest:.2f} mm, is {_REACH:g} radii", loc="left")
    axes.legend(loc="lower left")


def _boxes(axes: Axes, rows: Residuals) -> None:
    sets = [
        (np.maximum(np.abs(values[which]), _LEAST_MM), f"{name},\n{when}", colour)
        for name, which in (("fit", rows.fitted), ("held out", rows.held_out))
        for when, values, colour in (("before", rows.signed_before, BEFORE), ("after", rows.signed_after, ACCENT))
    ]
    drawn = axes.boxplot(
        [values for values, _, _ in sets],
        widths=0.5,
        patch_artist=True,
        tick_labels=[label for _, label, _ in sets],
        medianprops={"color": INK},
        whiskerprops={"color": INK, "linewidth": 0.8},
        capprops={"color": INK, "linewidth": 0.8},
        flierprops={"marker": ".", "markersize": 4},
    )
    for box, (_, _, colour) in zip(drawn["boxes"], sets, strict=True):
        box.set(facecolor=colour, alpha=0.6, linewidth=0.6)
    for place, (mean, most) in zip((3, 4), HELD_OUT_PUBLISHED, strict=True):
        axes.plot([place + 0.38] * 2, [mean, most], "_", color=HELD_OUT, markersize=9, markeredgewidth=1.6)
    axes.plot([], [], "_", color=HELD_OUT, markersize=9, markeredgewidth=1.6, label="published: mean, largest")
    axes.set_yscale("log")
    millimetres(axes, "y")
    axes.set(ylabel="|residual|, mm")
    axes.grid(axis="x", visible=False)
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0))


SECTION = ReportSection(
    id="sphere-convergence",
    title="One sphere beside its paper",
    order=35,
    needs=(ConvergenceRow, ResidualsRow),
    build=build,
    template="""\
<table>
<thead><tr><th rowspan="2">|residual|, mm</th><th colspan="3">mean</th><th colspan="3">largest</th></tr>
<tr><th>before</th><th>after</th><th>less by</th><th>before</th><th>after</th><th>less by</th></tr></thead>
<tbody>
{% for line in lines %}
<tr><th>{{ line.name }}</th>{% for text in line.mean + line.max %}<td>{{ text }}</td>{% endfor %}</tr>
{% endfor %}
</tbody>
</table>
<p class="note">Published: Wang et al. 2024, another KR5 R1400. Its simulation has other errors, and no noise.</p>
<figure>{{ convergence | safe }}
<figcaption>The paper's figure 6. The last fit of the identification, repeated from the nominal robot:
{{ iterations }} iterations. The paper's ended after 50.</figcaption></figure>
<figure>{{ one_by_one | safe }}
<figcaption>The paper's figures 8 and 11. Residuals under 0.0001 mm are drawn at 0.0001 mm.</figcaption></figure>
<figure>{{ about | safe }}
<figcaption>Left, the paper's figure 7: each touch at its height on the sphere, all directions in one half-plane;
● fit, ◆ held out. Right: box from quartile to quartile, line at the median, whiskers to 1.5 times the
box.</figcaption></figure>
""",
)
