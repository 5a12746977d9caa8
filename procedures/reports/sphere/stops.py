"""The stops of the searches: over-travel, cycles, telegrams."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from cellctl.formats import ModelFile
from cellctl.kinematics import Bools, Floats
from cellctl.report import ReportSection, Run
from cellctl.report.drawing import ACCENT, INK, svg_of
from cellctl.report.figures import fixed
from procedures.steps.sphere.rows import SphereVerdict, StopFigures, TouchRow

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


def build(run: Run) -> Mapping[str, Any]:
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


SECTION = ReportSection(
    id="sphere-stops",
    title="Stops",
    order=80,
    needs=(TouchRow,),
    build=build,
    template="""\
<p>{{ texts | join("; ") }}.</p>
{% if picture %}
<figure>{{ picture | safe }}</figure>
{% endif %}
""",
)
