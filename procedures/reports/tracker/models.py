"""Models beside published ones: on the same poses, with the similarity of near errors; and in six dimensions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from cellctl.analysis import ErrorSet, UnsuitableRows, similarity
from cellctl.records import IdentificationRow, ResidualsRow
from cellctl.report import (
    ACCENT,
    DASH,
    HELD_OUT,
    ReportSection,
    Residuals,
    Run,
    Sigma,
    by_joint,
    error_curves,
    fixed,
    millimetres,
    model_cells,
    percent,
    svg_of,
)
from procedures.steps.tracker.rows import ComparedModelsRow, SixFigures, SixRow

PUBLISHED_MODELS = {
    "kriging, weights searched": ("0.089", "0.172"),
    "perceptron over the position": ("0.212", "0.359"),
    "inverse distance over the position": ("0.502", "0.942"),
}
"""Mean and largest error of 80 held-out poses, mm: Meng et al. 2024, KUKA KR 300 R2500, 160 poses."""


def _models(run: Run) -> Mapping[str, Any] | None:
    """The table, the curves, and the semivariograms over each joint."""
    row = run.state.last(ComparedModelsRow)
    if row is None or not row.models:
        return None
    errors = [(each.choice, np.array(of)) for each, of in zip(row.models, row.errors, strict=True)]
    kriging = "kriging" in row.models[0].choice
    return {
        "rows": [model_cells(each) for each in row.models],
        "left_out": row.left_out,
        "errors": error_curves(np.array(row.nominal), errors),
        "published": [(name, *figures) for name, figures in PUBLISHED_MODELS.items()] if kriging else [],
        "joints": _joints(run) if kriging else "",
    }


def _joints(run: Run) -> str:
    """Semivariograms of the registered nominal robot's error over each joint; empty where the rows allow none."""
    rows, found = run.state.last(ResidualsRow), run.state.last(IdentificationRow)
    if rows is None or found is None:
        return ""
    residuals = Residuals.of_row(rows)
    turns = np.array(found.base_turns, float)
    in_base = -np.einsum("nji,nj->ni", turns[residuals.session], residuals.before)  # actual − nominal
    try:
        alike = similarity(ErrorSet.of(residuals.readings, residuals.tip_base, in_base), permutations=1)
    except UnsuitableRows:
        return ""
    return by_joint(alike, sorted({joint for each in alike.by_joint.values() for joint in each}))


MODELS_SECTION = ReportSection(
    id="tracker-models",
    title="Models on the same poses",
    order=27,
    needs=(ComparedModelsRow,),
    build=_models,
    sigmas=(
        Sigma(
            "less than the first, 95 %",
            "the difference of the mean errors of two models on the held-out poses",
            "paired t over the poses; of one comparison",
            "95 % interval",
        ),
    ),
    template="""\
<table>
<thead><tr><th>model</th><th>mean, mm</th><th>RMS</th><th>max</th><th>in 95 %</th><th>σ ratio</th>
<th>less than the first</th><th>95 %</th></tr></thead>
<tbody>
{% for row in rows %}
<tr><th>{{ row.choice }}</th>{% for text in row.figures %}<td class="after">{{ text }}</td>{% endfor %}
<td>{{ row.inside }}</td><td>{{ row.ratio }}</td><td>{{ row.less }}</td><td>{{ row.ends }}</td></tr>
{% endfor %}
{% for name, mean, largest in published %}
<tr><th>published: {{ name }}</th><td>{{ mean }}</td><td></td><td>{{ largest }}</td><td colspan="4"></td></tr>
{% endfor %}
</tbody>
</table>
<p class="note">Held-out poses, which no model was made from. The first model made the table; the others are computed
from the same poses. σ ratio: RMS stated over RMS found.
{% if published %}Published: Meng et al. 2024, another robot.{% endif %}</p>
{% for words in left_out %}
<p class="note">Left out: {{ words }}.</p>
{% endfor %}
<figure>{{ errors | safe }}</figure>
{% if joints %}
<figure>{{ joints | safe }}
<figcaption>Semivariogram of the nominal robot's error over the standardised angle of each joint: colour, all pairs (the
paper's figure 10); dashed, the tenth that is nearest in the other joints. A curve that rises shows a joint that the
errors depend on.</figcaption></figure>
{% endif %}
""",
)


PUBLISHED_SIX = {
    "poses of the fit": ("89 %", "48 %", "0.119, 0.106, 0.405 → 0.022, 0.020, 0.036 mm (stated: 88.7 % and 56.6 %)"),
    "held-out poses": ("55.2 %", "30.2 %", DASH),
}
"""Reduction of the mean position error and of the mean attitude error, and the means by axis: Stäubli TX60, Leica AT960
with T-MAC, 50 + 30 poses. The reductions on the fit follow from the printed means."""


def _six(run: Run) -> Mapping[str, Any] | None:
    """Table and picture."""
    row = run.state.last(SixRow)
    if row is None:
        return None
    rows = [_line("poses of the fit", row.fit), _line("held-out poses", row.test)]
    redundant = [name for name, size in zip(row.parameters, row.r, strict=True) if size < row.observable]
    return {
        "rows": rows,
        "published": [(name, *values) for name, values in PUBLISHED_SIX.items()],
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


SIX_SECTION = ReportSection(
    id="tracker-six",
    title="Poses in six dimensions",
    order=25,
    needs=(SixRow,),
    build=_six,
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
