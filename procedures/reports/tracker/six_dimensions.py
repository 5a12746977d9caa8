"""Poses in six dimensions: errors by axis and angle beside published ones, and |R_ii| of the QR."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from cellctl.report import ReportSection, Run, Sigma
from cellctl.report.drawing import ACCENT, HELD_OUT, millimetres, svg_of
from cellctl.report.figures import DASH, fixed, percent
from procedures.steps.tracker.rows import SixFigures, SixRow

PUBLISHED = {
    "poses of the fit": ("89 %", "48 %", "0.119, 0.106, 0.405 → 0.022, 0.020, 0.036 mm (stated: 88.7 % and 56.6 %)"),
    "held-out poses": ("55.2 %", "30.2 %", DASH),
}
"""Reduction of the mean position error and of the mean attitude error, and the means by axis: Stäubli TX60, Leica AT960
with T-MAC, 50 + 30 poses. The reductions on the fit follow from the printed means."""


def build(run: Run) -> Mapping[str, Any] | None:
    """Table and picture."""
    row = run.state.last(SixRow)
    if row is None:
        return None
    rows = [_line("poses of the fit", row.fit), _line("held-out poses", row.test)]
    redundant = [name for name, size in zip(row.parameters, row.r, strict=True) if size < row.observable]
    return {
        "rows": rows,
        "published": [(name, *values) for name, values in PUBLISHED.items()],
        "picture": _picture(row),
        "redundant": ", ".join(redundant) or "none",
        "count": len(row.parameters),
    }


def _line(name: str, figures: SixFigures) -> dict[str, Any]:
    """A line of the table: means by axis, angle, and their reductions."""
    lengths = [float(np.linalg.norm(values)) for values in (figures.before, figures.after)]
    angles = figures.angle_before, figures.angle_after
    return {
        "name": f"{figures.n} {name}",
        "before": ", ".join(fixed(value) for value in figures.before),
        "after": ", ".join(fixed(value) for value in figures.after),
        "position": percent(1.0 - lengths[1] / lengths[0]) if lengths[0] else DASH,
        "angles": f"{fixed(angles[0])} → {fixed(angles[1])}",
        "attitude": percent(1.0 - angles[1] / angles[0]) if angles[0] else DASH,
    }


def _picture(row: SixRow) -> str:
    def draw(figure: Figure) -> None:
        axes, at = figure.subplots(), np.arange(len(row.r))
        axes.bar(at, np.maximum(row.r, 1e-3), color=ACCENT)
        axes.axhline(row.observable, color=HELD_OUT, linewidth=1.0)
        axes.text(len(at) - 0.4, row.observable * 1.5, "below: redundant", color=HELD_OUT, fontsize=7, ha="right")
        axes.set_yscale("log")
        millimetres(axes, "y")
        axes.set_xticks(at, row.parameters, rotation=90, fontsize=6)
        axes.set(ylabel="|R_ii|, σ of the rows per prior σ", xlim=(-0.7, len(at)))
        axes.grid(axis="x", visible=False)

    return svg_of(draw, "r-ii", 2.6, "Diagonal of R of the pivoted QR, parameter by parameter")


SECTION = ReportSection(
    id="tracker-six",
    title="Poses in six dimensions",
    order=25,
    needs=(SixRow,),
    build=build,
    sigmas=(
        Sigma(
            "|R_ii|",
            "one parameter, beyond what those before it explain",
            "column-pivoted QR of the rows' derivatives, in their σ, by one prior σ of the parameter",
            "ratio of standard deviations",
        ),
    ),
    template="""\
<table>
<thead><tr><th></th><th>mean |Δx|, |Δy|, |Δz| before, mm</th><th>after</th><th>position</th><th>mean angle, °</th>
<th>attitude</th></tr></thead>
<tbody>
{% for row in rows %}
<tr><th>{{ row.name }}</th><td>{{ row.before }}</td><td class="after">{{ row.after }}</td><td>{{ row.position }}</td>
<td>{{ row.angles }}</td><td>{{ row.attitude }}</td></tr>
{% endfor %}
{% for name, position, attitude, means in published %}
<tr><th>published, {{ name }}</th><td colspan="2">{{ means }}</td><td>{{ position }}</td><td></td>
<td>{{ attitude }}</td></tr>
{% endfor %}
</tbody>
</table>
<p class="note">Position and attitude: reduction of the mean error. Before: the nominal robot with base and tool
registered. Published: Stäubli TX60, Leica AT960, 50 + 30 poses.</p>
<figure>{{ picture | safe }}</figure>
<p>{{ count }} free parameters, in the order of the pivots. Redundant, left to the prior: {{ redundant }}.</p>
""",
)
