"""Models on the same poses beside the campaign's own, and how alike the errors of near postures are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cellctl.analysis import ErrorSet, UnsuitableRows, similarity
from cellctl.records import IdentificationRow, ResidualsRow
from cellctl.report import ReportSection, Run, Sigma
from cellctl.report.compared_fits import error_curves, model_cells
from cellctl.report.fit.residuals import Residuals
from cellctl.report.similarity import by_joint
from procedures.steps.tracker.rows import ComparedModelsRow

PUBLISHED = {
    "kriging, weights searched": ("0.089", "0.172"),
    "perceptron over the position": ("0.212", "0.359"),
    "inverse distance over the position": ("0.502", "0.942"),
}
"""Mean and largest error of 80 held-out poses, mm: Meng et al. 2024, KUKA KR 300 R2500, 160 poses."""


def build(run: Run) -> Mapping[str, Any] | None:
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
        "published": [(name, *figures) for name, figures in PUBLISHED.items()] if kriging else [],
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


SECTION = ReportSection(
    id="tracker-models",
    title="Models on the same poses",
    order=27,
    needs=(ComparedModelsRow,),
    build=build,
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
