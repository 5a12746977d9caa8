"""The returns to the reference touch, and the drift through them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from cellctl.report import ReportSection, Run, Sigma
from cellctl.report.drawing import ACCENT, INK, svg_of
from cellctl.report.figures import fixed, plain, significant, with_sigma
from procedures.steps.sphere.rows import DriftFigures, ReferenceRow, SphereVerdict


def reference_picture(rows: Sequence[ReferenceRow], drift: DriftFigures | None) -> str:
    """The shift of the reference touch along its normal over the run, with 1 σ, and the drift if it was modelled."""

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        axes.axhline(0.0, color=INK, linewidth=0.6)
        spheres = dict.fromkeys(row.sphere for row in rows)
        for sphere, marker in zip(spheres, "osD^v" * len(spheres), strict=False):
            mine = [row for row in rows if row.sphere == sphere]
            at, shift, sigma = ([getattr(row, name) for row in mine] for name in ("number", "shift_mm", "sigma_mm"))
            axes.errorbar(at, shift, sigma, fmt=f"{marker}-", color=ACCENT, markersize=4, linewidth=0.8, label=sphere)
        if drift is not None and drift.modelled:
            first = float(rows[0].repeats)
            ends = np.array([first, max(row.number for row in rows)])
            line = drift.mm_per_touch * (ends - first)
            axes.plot(ends, line, "--", color=INK, linewidth=1.0, label="drift, modelled")
        axes.set(xlabel="contacts made before", ylabel="shift along the normal, mm")
        axes.legend(loc="best")

    return svg_of(draw, "reference", 1.9, "Shift of the reference touch in the course of the run")


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
