"""A campaign in batches: the error that was predicted after each, and what ended it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure

from cellctl.records import BatchRow
from cellctl.report._page import ReportSection
from cellctl.report._run import Run
from cellctl.report.budget import Sigma
from cellctl.report.drawing import ACCENT, HELD_OUT, millimetres, svg_of
from cellctl.report.figures import DASH, fixed


def curve_picture(rows: Sequence[BatchRow]) -> str:
    """Median and 95 % quantile over the number of rows, the band between 5 % and 95 %, and the goal."""

    def draw(figure: Figure) -> None:
        axes, at = figure.subplots(), [row.rows for row in rows]
        low, middle, high = ([getattr(row, name) for row in rows] for name in ("low_mm", "median_mm", "high_mm"))
        axes.fill_between(at, low, high, color=ACCENT, alpha=0.15, linewidth=0, label="5 % … 95 %")
        axes.plot(at, high, "o-", color=ACCENT, markersize=4, linewidth=1.2, label="95 %")
        axes.plot(at, middle, ".--", color=ACCENT, markersize=4, linewidth=0.9, label="median")
        axes.axhline(rows[-1].goal_mm, color=HELD_OUT, linewidth=1.0, label="goal")
        axes.set_yscale("log")
        millimetres(axes, "y")
        axes.set(xlabel=f"{rows[-1].noun} of the fit", ylabel="volumetric error, mm")
        axes.legend(loc="best")

    return svg_of(draw, "batches", 2.2, "Predicted volumetric error after each batch")


def build(run: Run) -> Mapping[str, Any]:
    """Picture, a line for each batch, and what became of the goal."""
    rows = run.state.recorded(BatchRow)
    goal = (run.figures or {}).get("goal")
    return {
        "picture": curve_picture(rows),
        "lines": [_line(row) for row in rows],
        "noun": rows[-1].noun,
        "sentence": rows[-1].sentence,
        "judged": goal["why"] if goal else "",
        "met": bool(goal and goal["met"]),
    }


def _line(row: BatchRow) -> list[str]:
    quantiles = (row.low_mm, row.median_mm, row.high_mm, row.next_mm)
    to_goal = DASH if row.to_goal is None else str(row.to_goal)
    return [str(row.rows), *map(fixed, quantiles), to_goal, fixed(row.seconds / 60.0, 1), row.model]


SECTION = ReportSection(
    id="batches",
    title="Batches until the goal",
    order=45,
    needs=(BatchRow,),
    build=build,
    sigmas=(
        Sigma(
            "volumetric error after a batch",
            "the RMS error, 3-D, over the joint ranges of the held-out rows, without a common rigid motion",
            "weighted chi-squared distribution, by the covariance of the fit",
            "5 %, 50 % and 95 % quantile",
        ),
    ),
    template="""\
<p>{{ sentence }}.{% if judged %} The goal is <b>{{ "met" if met else "not met" }}</b>: {{ judged }}.{% endif %}</p>
<figure>{{ picture | safe }}</figure>
<table>
<thead><tr><th>{{ noun }}</th><th>5 %, mm</th><th>median, mm</th><th>95 %, mm</th><th>95 % after the next batch, mm</th>
<th>more for the goal</th><th>min used</th><th>model</th></tr></thead>
<tbody>
{% for line in lines %}
<tr>{% for text in line %}<td>{{ text }}</td>{% endfor %}</tr>
{% endfor %}
</tbody>
</table>
<p class="note">Held-out {{ noun }} take no part in these figures. They judge the model, and the goal, afterwards.</p>
""",
)
