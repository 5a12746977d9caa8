"""The tool by four points: taught, found, its σ, and the error of each contact."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from cellctl.report import ACCENT, BEFORE, FAINT, INK, ReportSection, Run, Sigma, fixed, svg_of
from procedures.steps.tool.rows import ToolErrorsRow, ToolVerdict


def build(run: Run) -> Mapping[str, Any] | None:
    """Offsets by axis, and the picture of the errors."""
    verdict, errors = run.state.last(ToolVerdict), run.state.last(ToolErrorsRow)
    if verdict is None or errors is None:
        return None
    tool = verdict.tool
    columns = zip("xyz", tool.taught, tool.found, tool.difference, tool.sigma, tool.point, strict=True)
    return {
        "axes": [(name, *(fixed(value) for value in values)) for name, *values in columns],
        "orientations": tool.orientations,
        "contacts": tool.contacts,
        "scatter": fixed(tool.scatter_mm),
        "common": None if tool.common_mm is None else fixed(tool.common_mm),
        "picture": errors_picture(errors),
    }


def errors_picture(errors: ToolErrorsRow) -> str:
    """The error of each contact by tool orientation, taught and found; held-out orientations shaded."""
    orientation, held_out = np.array(errors.orientation), np.array(errors.held_out)

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        axes.axhline(0.0, color=INK, linewidth=0.6)
        if not held_out.all():
            for each in np.unique(orientation[held_out]):
                label = "held out" if each == orientation[held_out].min() else None
                axes.axvspan(each + 0.5, each + 1.5, color=FAINT, alpha=0.5, linewidth=0, label=label)
        for values, shift, colour, label in (
            (errors.taught, -0.15, BEFORE, "taught"),
            (errors.found, 0.15, ACCENT, "found"),
        ):
            axes.plot(orientation + 1 + shift, values, "o", color=colour, markersize=3.5, label=f"{label} tool")
        axes.set(xlabel="tool orientation", ylabel="error of the contact, mm")
        axes.set_xticks(range(1, int(orientation.max()) + 2))
        axes.grid(visible=False, axis="x")
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))

    return svg_of(draw, "tool", 2.3, "Error of each contact by tool orientation, with taught and with found tool")


SECTION = ReportSection(
    id="tool",
    title="Tool",
    order=20,
    needs=(ToolErrorsRow,),
    build=build,
    sigmas=(
        Sigma(
            "tool, 1 σ",
            "noise of the contacts, and the robot model's error that differs from orientation to orientation",
            "generalised least squares; both sizes from the residuals by restricted maximum likelihood. An error of "
            "the model that acts like a tool offset in every orientation (last link, zeros of the last joints) is "
            "part of the found tool, not of its σ",
            "1 σ",
        ),
    ),
    template="""\
<table>
<thead><tr><th></th><th>taught</th><th>found</th><th>difference</th><th>1 σ</th><th>point, base frame</th></tr></thead>
<tbody>
{% for name, taught, found, difference, sigma, point in axes %}
<tr><th>{{ name }}, mm</th><td>{{ taught }}</td><td>{{ found }}</td><td>{{ difference }}</td><td>{{ sigma }}</td>
<td>{{ point }}</td></tr>
{% endfor %}
</tbody></table>
<p>From {{ contacts }} contacts in {{ orientations }} tool orientations. A contact scatters by {{ scatter }} mm (1 σ)
{%- if common is not none %}; the robot's model adds {{ common }} mm per axis (1 σ) that differs between orientations
{%- endif %}. The run folder has the line for the robot file in <code>tool.yaml</code>; nothing was changed on the
controller.</p>
<figure>{{ picture | safe }}</figure>
""",
)
