"""Touches by sphere, the stops of their searches, and the reference touches over the run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from cellctl.calibration import ErrorFigures
from cellctl.formats import ModelFile
from cellctl.kinematics import Bools, Floats
from cellctl.records import ResidualsRow
from cellctl.report import (
    ACCENT,
    INK,
    ReportSection,
    Residuals,
    Run,
    Sigma,
    fixed,
    plain,
    significant,
    svg_of,
    with_sigma,
)
from procedures.steps.sphere.rows import DriftFigures, ReferenceRow, SphereVerdict, StopFigures, TouchRow


def _by_sphere(run: Run) -> Mapping[str, Any] | None:
    """Counts and figures of each sphere; touches that the fit left out are not counted."""
    stored = run.state.last(ResidualsRow)
    if stored is None:
        return None
    every = Residuals.of_row(stored)
    rows = every.pick(every.fitted | every.held_out)
    return {
        "spheres": [_of_sphere(rows.pick(rows.point == name)) for name in sorted(set(rows.point.tolist()))],
        "sentences": [*_outside(run, rows), *_left_out(len(every) - len(rows))],
    }


def _of_sphere(rows: Residuals) -> dict[str, Any]:
    before, after = (ErrorFigures.of(np.abs(values)) for values in (rows.signed_before, rows.signed_after))
    return {
        "name": rows.point[0],
        "fit": int(rows.fitted.sum()),
        "held_out": int(rows.held_out.sum()),
        "before": [fixed(value) for value in (before.mean, before.rms, before.max)],
        "after": [fixed(value) for value in (after.mean, after.rms, after.max)],
    }


def _outside(run: Run, rows: Residuals) -> Iterator[str]:
    """Number of held-out touches outside the measured joint region, and their largest error."""
    outside = rows.held_out & ~run.model.inside(rows.readings) if run.model else np.zeros(len(rows), bool)
    if outside.any():
        greatest = fixed(float(np.abs(rows.signed_after[outside]).max()))
        yield (
            f"{outside.sum()} held-out {'touch lies' if outside.sum() == 1 else 'touches lie'} outside the measured "
            f"joint region, where the model extrapolates; greatest error there {greatest} mm."
        )


def _left_out(count: int) -> Iterator[str]:
    if count:
        words = "touch left out of the fit is" if count == 1 else "touches left out of the fit are"
        yield f"{count} {words} not counted here; see the section on rows left out."


TOUCHES_SECTION = ReportSection(
    id="sphere-touches",
    title="Touches by sphere",
    order=30,
    needs=(TouchRow, ResidualsRow),
    build=_by_sphere,
    template="""\
<p>Distance of the tip's centre from the sphere's surface, with the tip radius taken off. Before: nominal robot, with
only the sphere centres fitted.
{{ sentences | join(" ") }}</p>
<table class="figures">
<thead>
<tr><th rowspan="2">|residual|, mm</th><th colspan="2">touches</th><th colspan="3">before</th>
<th colspan="3">after</th></tr>
<tr><th>fit</th><th>held out</th><th>mean</th><th>RMS</th><th>max</th><th>mean</th><th>RMS</th><th>max</th></tr>
</thead>
<tbody>
{% for sphere in spheres %}
<tr><th>{{ sphere.name }}</th><td>{{ sphere.fit }}</td><td>{{ sphere.held_out }}</td>
{% for text in sphere.before %}<td>{{ text }}</td>{% endfor %}
{% for text in sphere.after %}<td class="after">{{ text }}</td>{% endfor %}</tr>
{% endfor %}
</tbody>
</table>
""",
)


_FATES = ("late", "lost", "skipped")


def over_travel_picture(travel: Floats, faulty: Bools) -> str:
    """The tip's over-travel from contact to rest (N,), mm, for each touch; crosses mark telegram errors (N,)."""
    at = np.arange(1, len(travel) + 1)

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        axes.plot(at, travel, "o", color=ACCENT, markersize=2.5)
        if faulty.any():
            axes.plot(at[faulty], travel[faulty], "x", color=INK, markersize=7, label="late, lost or skipped telegrams")
            axes.legend(loc="best")
        axes.set(xlabel="touch, in the order of the run", ylabel="over-travel, mm")
        axes.set_ylim(0.0, 1.15 * float(travel.max()) or 1.0)

    return svg_of(draw, "over-travel", 1.6, "Over-travel of the tip after contact, touch by touch")


def _stops(run: Run) -> Mapping[str, Any]:
    """Figures, and a picture if there is a model."""
    rows, verdict = run.state.recorded(TouchRow), run.state.last(SphereVerdict)
    return {
        "picture": _picture(run.model, rows) if run.model else "",
        "texts": list(_texts(rows, verdict.stops if verdict else None)),
    }


def _texts(rows: Sequence[TouchRow], stops: StopFigures | None) -> Iterator[str]:
    yield f"{len(rows)} touches"
    if stops is not None:
        mean, greatest = fixed(stops.overtravel_mean_mm), fixed(stops.overtravel_max_mm)
        yield f"over-travel from contact to rest {mean} mm mean, {greatest} mm at most"
    yield f"stopped within {max(row.stop_cycles for row in rows)} cycles of the contact"
    yield "telegrams " + ", ".join(f"{fate} {sum(getattr(row, fate) for row in rows)}" for fate in _FATES)
    yield f"touches that needed a second attempt: {sum(row.attempt > 1 for row in rows)}"


def _picture(model: ModelFile, rows: Sequence[TouchRow]) -> str:
    """The tip's over-travel from contact to rest by the identified robot."""
    joints, robot = model.robot.joint_map(), model.robot_model()
    contact = robot.tcp(joints.model(np.array([row.joints for row in rows])))
    rest = robot.tcp(joints.model(np.array([row.resting for row in rows])))
    faulty = np.array([any(getattr(row, fate) for fate in _FATES) for row in rows])
    return over_travel_picture(np.linalg.norm(rest - contact, axis=1), faulty)


STOPS_SECTION = ReportSection(
    id="sphere-stops",
    title="Stops",
    order=80,
    needs=(TouchRow,),
    build=_stops,
    template="""\
<p>{{ texts | join("; ") }}.</p>
{% if picture %}
<figure>{{ picture | safe }}</figure>
{% endif %}
""",
)


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


def _references(run: Run) -> Mapping[str, Any]:
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


REFERENCE_SECTION = ReportSection(
    id="sphere-reference",
    title="Reference touches",
    order=70,
    needs=(ReferenceRow,),
    build=_references,
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
