"""The stops of the searches: over-travel, cycles, telegrams."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from cellctl.formats import ModelFile
from cellctl.report import ReportSection, Run
from cellctl.report.figures import fixed
from procedures.reports.sphere.reference_touches import over_travel_picture
from procedures.steps.sphere.rows import SphereVerdict, StopFigures, TouchRow

_FATES = ("late", "lost", "skipped")


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
