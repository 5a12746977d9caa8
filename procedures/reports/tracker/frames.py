"""The frames {B} and {T} by turned axes, with their σ."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cellctl.kinematics import abc_from_rotation
from cellctl.report import ReportSection, Run, Sigma
from cellctl.report.figures import significant, with_sigma
from procedures.steps.tracker.rows import FrameFigures, FramesRow


def build(run: Run) -> Mapping[str, Any] | None:
    """The frames by place and angles, the circles, the reflector, gravity."""
    row = run.state.last(FramesRow)
    if row is None:
        return None
    off = float(np.linalg.norm(np.subtract(row.reflector, row.rough)))
    circles = zip(("A1", "A2", "A5", "A6"), row.radius, row.radius_sigma, row.residual, strict=True)
    return {
        "frames": [
            ("{B}, instrument's frame", _cells(row.base)),
            ("{T}, instrument's frame", _cells(row.tool)),
            ("instrument, base frame", _cells(row.station)),
        ],
        "circles": [(axis, with_sigma(radius, sigma), significant(rest)) for axis, radius, sigma, rest in circles],
        "outliers": row.outliers,
        "reflector": list(map(with_sigma, row.reflector, row.reflector_sigma)),
        "off": significant(off),
        "gravity": _gravity(row),
    }


def _cells(frame: FrameFigures) -> list[str]:
    """X, Y, Z, mm; the turn's A, B, C, deg, with the largest σ of the turn."""
    matrix = np.array(frame.matrix)
    places = [with_sigma(value, sigma) for value, sigma in zip(matrix[:3, 3], frame.sigma[:3], strict=True)]
    angles = [with_sigma(value, max(frame.sigma[3:])) for value in abc_from_rotation(matrix[:3, :3])]
    return [text.replace(" ± ", "\N{NO-BREAK SPACE}±\N{NO-BREAK SPACE}") for text in (*places, *angles)]


def _gravity(row: FramesRow) -> str:
    if row.gravity_deg is None or row.gravity_sigma_deg is None:
        return "The instrument is not levelled: it shows nothing of gravity."
    angle = with_sigma(row.gravity_deg, row.gravity_sigma_deg)
    return f"The levelled instrument's vertical and that of the robot file include {angle}°."


SECTION = ReportSection(
    id="tracker-frames",
    title="Frames by turned axes",
    order=30,
    needs=(FramesRow,),
    build=build,
    sigmas=(
        Sigma(
            "frames ± σ",
            "one coordinate of a frame; of its angles, the largest of the three turns",
            "circle fits, with the common part of the instrument's error; errors of the robot's links are not in it",
            "1 σ",
        ),
    ),
    template="""\
<p>{B}: z on A1, x along the common perpendicular of A1 and A2. {T}: x on A6, z perpendicular to A5 and A6, origin at
the reflector.</p>
<table style="font-size: .74rem">
<thead><tr><th>frame</th><th>X, mm</th><th>Y, mm</th><th>Z, mm</th><th>A, °</th><th>B, °</th><th>C, °</th></tr></thead>
<tbody>
{% for name, cells in frames %}
<tr><th>{{ name }}</th>{% for cell in cells %}<td>{{ cell }}</td>{% endfor %}</tr>
{% endfor %}
</tbody>
</table>
<table>
<thead><tr><th>circle of</th><th>radius, mm</th><th>residual, mm RMS</th></tr></thead>
<tbody>
{% for axis, radius, rest in circles %}
<tr><th>{{ axis }}</th><td>{{ radius }}</td><td>{{ rest }}</td></tr>
{% endfor %}
</tbody>
</table>
<p>Reflector in the flange frame: {{ reflector | join(", ") }} mm, {{ off }} mm from the cell file's place.
{% if outliers %}{{ outliers }} points of the circles are outliers and were left out.{% endif %} {{ gravity }}</p>
""",
)
