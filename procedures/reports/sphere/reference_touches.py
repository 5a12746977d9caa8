"""The returns to the reference touch, and the drift through them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cellctl.report import ReportSection, Run, Sigma
from cellctl.report.figures import fixed, plain, significant, with_sigma
from procedures.reports.sphere.run_pictures import reference_picture
from procedures.steps.sphere.rows import DriftFigures, ReferenceRow, SphereVerdict


def build(run: Run) -> Mapping[str, Any]:
    """Picture and drift."""
    rows, verdict = run.state.recorded(ReferenceRow), run.state.last(SphereVerdict)
    drift = verdict.drift if verdict else None
    return {"picture": reference_picture(rows, drift), "count": len(rows), "drift": _pairs(drift) if drift else []}


def _pairs(drift: DriftFigures) -> list[tuple[str, str]]:
    return [
        ("drift, mm per touch", with_sigma(drift.mm_per_touch, drift.sigma_mm_per_touch)),
        ("drift over its σ", significant(abs(drift.t)) if drift.mm_per_touch else "0"),
        ("over all touches, mm", fixed(drift.total_mm)),
        ("larger than chance explains", plain(drift.significant)),
        ("corrected in the data set", plain(drift.modelled)),
    ]


SECTION = ReportSection(
    id="sphere-reference",
    title="Reference touches",
    order=70,
    needs=(ReferenceRow,),
    build=build,
    sigmas=(
        Sigma(
            "bars of the reference touches",
            "the difference of two touches",
            "√2 times the repeatability of the robot along one axis",
            "1 σ",
        ),
        Sigma("drift ± σ", "the change for each touch", "line through the visits", "1 σ"),
    ),
    template="""\
{% from "pairs.html" import pairs %}
<p>{{ count }} visits to the same touch. Wear of the tip, warming of the robot or a collision moves it.</p>
<figure>{{ picture | safe }}</figure>
{{ pairs(drift) if drift else "" }}
""",
)
