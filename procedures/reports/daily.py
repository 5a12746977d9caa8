"""The daily check: control charts of T² and EWMA, and the deviation of each feature of the last run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from cellctl.report import ACCENT, HELD_OUT, INK, ReportSection, Run, Sigma, svg_of
from procedures.steps.daily.rows import ControlChartRow, DailyPointsRow, DailyVerdict, EarlierRunsRow

_SHOWN = 60
"""Runs in the picture, the last ones."""


def build(run: Run) -> Mapping[str, Any] | None:
    """Charts and deviations; while the baseline grows, its runs."""
    verdict, chart = run.state.last(DailyVerdict), run.state.last(ControlChartRow)
    earlier = run.state.last(EarlierRunsRow)
    if verdict is None:
        return None
    return {
        "daily": verdict.daily,
        "percent": f"{100 * verdict.daily.false_alarm:.2g}",
        "picture": chart_picture(chart) if chart else "",
        "features": list(zip(chart.features, [f"{value:+.1f}" for value in chart.deviations[-1]], strict=True))
        if chart
        else [],
        "left_out": earlier.left_out if earlier else (),
    }


def chart_picture(chart: ControlChartRow) -> str:
    """T² and EWMA of the runs since the baseline, with their limits."""
    first = max(0, len(chart.t2) - _SHOWN)
    numbers = np.arange(first, len(chart.t2)) + 1
    alarm = np.array([verdict != "in control" for verdict in chart.verdict[first:]])

    def draw(figure: Figure) -> None:
        pair = figure.subplots(1, 2)
        for axes, values, limit, name in (
            (pair[0], chart.t2, chart.t2_limit, "T²"),
            (pair[1], chart.ewma, chart.ewma_limit, "EWMA"),
        ):
            _draw_chart(axes, numbers, np.array(values[first:]), alarm, limit)
            axes.set(xlabel=f"run since the baseline (last: {chart.began[-1][:10]})", ylabel=name)

    return svg_of(draw, "control-chart", 2.4, "Control charts: T squared and EWMA of each run, with their limits")


def _draw_chart(axes: Axes, numbers: Any, values: Any, alarm: Any, limit: float) -> None:
    axes.plot(numbers, values, "-", color=ACCENT, linewidth=0.8)
    axes.plot(numbers[~alarm], values[~alarm], "o", color=ACCENT, markersize=4, label="in control")
    if alarm.any():
        axes.plot(numbers[alarm], values[alarm], "D", color=HELD_OUT, markersize=5, label="reported")
    axes.axhline(limit, color=INK, linewidth=0.8, linestyle="--", label="limit")
    if values.max() > 5.0 * limit:
        axes.set_yscale("log")
    else:
        axes.set_ylim(0.0, 1.15 * max(limit, float(values.max())))
    axes.set_xlim(numbers[0] - 0.5, numbers[-1] + 0.5)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)


SECTION = ReportSection(
    id="daily",
    title="Control charts",
    order=10,
    needs=(DailyPointsRow, EarlierRunsRow, DailyVerdict),
    build=build,
    sigmas=(
        Sigma(
            "deviation, σ",
            "motion of all points together, and their scale, from the mean of the baseline",
            "scatter of the baseline's runs: robot, instrument and nests together",
            "1 σ of one run; of the EWMA where T² is within its limit",
        ),
    ),
    template="""\
<p>Baseline ‘{{ daily.baseline }}’: {{ daily.baseline_runs }} of {{ daily.baseline_needed }} runs.
{% if picture %}Limits are such that without a change {{ percent }} % of runs are beyond that of T², and as many beyond
that of the EWMA (a mean over 100 runs). A run beyond the limit of T² is measured again; two in succession, or one
beyond the limit of the EWMA: recalibrate.{% else %}Nothing is judged until it is complete.{% endif %}</p>
<p>The points are compared in the frame of the nests, so the instrument may stand elsewhere.</p>
{% if picture %}
<figure>{{ picture | safe }}</figure>
<table>
<thead><tr><th>feature</th><th>deviation, σ</th></tr></thead>
<tbody>
{% for name, value in features %}
<tr><th>{{ name }}</th><td>{{ value }}</td></tr>
{% endfor %}
</tbody></table>
{% endif %}
{% if left_out %}
<p>Earlier runs that are not compared:
{% for name, why in left_out %}{{ name }} ({{ why }}){{ ", " if not loop.last else "." }}{% endfor %}</p>
{% endif %}
""",
)
