"""Performance by ISO 9283: the table of figures, and the scatter of the five points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from cellctl.report import ACCENT, BEFORE, INK, ReportSection, Run, Sigma, fixed, svg_of
from procedures.steps.iso9283.planning import VARIED
from procedures.steps.iso9283.rows import IsoFigures, IsoRow, IsoVerdict, RegistrationRow

_POINTS = ("P1", "P2", "P3", "P4", "P5")


def build(run: Run) -> Mapping[str, Any] | None:
    """The table and the picture."""
    verdict, rows = run.state.last(IsoVerdict), run.state.recorded(IsoRow)
    registration = run.state.last(RegistrationRow)
    if verdict is None or registration is None:
        return None
    result = verdict.iso9283
    tests = [(name, test) for name, test in (("before", result.before), ("after", result.after)) if test]
    return {
        "result": result,
        "by": registration,
        "residual": fixed(registration.residual),
        "tests": [_test(name, test) for name, test in tests],
        "angles": tests[0][1].points[0].of_angles is not None,
        "points": _POINTS,
        "picture": scatter_picture(rows),
    }


def _test(name: str, test: IsoFigures) -> dict[str, Any]:
    """The lines of one test: name, unit, a cell for each of P1 … P5."""
    variation = {_POINTS[place]: each for place, each in zip(VARIED, test.variation, strict=False)}
    lines: list[tuple[str, list[str]]] = [
        ("AP, mm", [fixed(each.accuracy) for each in test.points]),
        *((f"AP {axis}, mm", [f"{each.of_axes[k]:+.3f}" for each in test.points]) for k, axis in enumerate("xyz")),
        ("RP, mm", [fixed(each.repeatability) for each in test.points]),
        ("RP of the instrument alone, mm", [fixed(each.instrument_rp) for each in test.points]),
    ]
    if variation:
        lines.append(("vAP, mm", [_or_empty(variation, point, lambda each: fixed(each.position)) for point in _POINTS]))
    if test.points[0].of_angles is not None:
        for k, axis in enumerate("abc"):
            lines.append((f"AP {axis}, °", [f"{(each.of_angles or ())[k]:+.4f}" for each in test.points]))
            lines.append((f"RP {axis}, °", [f"± {(each.angle_repeatability or ())[k]:.4f}" for each in test.points]))
            if variation:
                cells = [_or_empty(variation, point, lambda each, k=k: f"{each.angles[k]:.4f}") for point in _POINTS]
                lines.append((f"vAP {axis}, °", cells))
    distance = f"{test.distance_accuracy:+.3f}", f"± {test.distance_repeatability:.3f}"
    return {"name": name, "cycles": test.cycles, "complete": test.complete, "lines": lines, "distance": distance}


def _or_empty(variation: Mapping[str, Any], point: str, words: Any) -> str:
    return words(variation[point]) if point in variation else ""


def scatter_picture(rows: Sequence[IsoRow]) -> str:
    """Attained less commanded places of P1 … P5 in the base frame, from above and from a side; cross: the command."""
    away = {row.when: np.array(row.deviations) for row in rows}
    widest = 1.1 * max(float(np.abs(each).max()) for each in away.values())

    def draw(figure: Figure) -> None:
        panels = figure.subplots(2, 5, sharex=True, sharey=True)
        for line, (first, second, label) in enumerate(((0, 1, "Y, mm"), (0, 2, "Z, mm"))):
            for place, axes in enumerate(panels[line]):
                for when, colour in (("before", BEFORE), ("after", ACCENT)):
                    if when in away:
                        points = away[when][:, place]
                        axes.plot(points[:, first], points[:, second], "o", color=colour, markersize=2.2, alpha=0.7)
                axes.plot(0.0, 0.0, "+", color=INK, markersize=9)
                axes.set_xlim(-widest, widest)
                axes.set_ylim(-widest, widest)
                axes.set_aspect("equal")
                if line == 0:
                    axes.set_title(_POINTS[place])
                else:
                    axes.set_xlabel("X, mm")
            panels[line][0].set_ylabel(label)
        for when, colour in (("before", BEFORE), ("after", ACCENT)):
            if when in away:
                panels[0][0].plot([], [], "o", color=colour, markersize=4, label=when)
        figure.legend(loc="outside upper center", ncols=2)

    return svg_of(draw, "iso-scatter", 3.2, "Scatter of the five points about their commands, before and after")


SECTION = ReportSection(
    id="iso9283",
    title="Performance by ISO 9283",
    order=10,
    needs=(IsoRow, RegistrationRow, IsoVerdict),
    build=build,
    sigmas=(
        Sigma(
            "RP, RD",
            "attained position of one point, or distance between P2 and P4, over the cycles",
            "scatter of the cycles: robot and instrument together; the instrument's own is stated beside it",
            "l̄ + 3 S of the distances from their mean (RP); 3 S (angles, RD)",
        ),
    ),
    template="""\
<p>Cube with an edge of {{ "%g" | format(result.edge) }} mm. Speed: {{ "%g" | format(result.speed_percent) }} % of axis
speed between the poses, {{ "%g" | format(result.arrival_percent) }} % on arrival. Load: {{ result.load }},
{{ "%g" | format(result.payload_kg) }} kg. {{ result.reflectors }} reflectors at each pose:
{% if angles %}position and orientation{% else %}position only{% endif %}. Positions are of the first reflector.
The base frame was registered on {{ by.poses }} other poses by the {{ by.by }} robot (residual {{ residual }} mm RMS),
not on the judged points.{% if result.model_from %} After: joints by a table of the five points, from the model of
{{ result.model_from }}.{% endif %}</p>
{% for test in tests %}
<table>
<thead><tr><th>{{ test.name }}, {{ test.cycles }} cycles{% if not test.complete %} (the standard asks for 30)
{%- endif %}</th>
{% for point in points %}<th>{{ point }}</th>{% endfor %}</tr></thead>
<tbody>
{% for name, cells in test.lines %}
<tr><th>{{ name }}</th>{% for cell in cells %}<td>{{ cell }}</td>{% endfor %}</tr>
{% endfor %}
<tr><th>AD, RD between P2 and P4, mm</th><td>{{ test.distance[0] }}</td><td>{{ test.distance[1] }}</td><td></td>
<td></td><td></td></tr>
</tbody></table>
{% endfor %}
<figure>{{ picture | safe }}</figure>
""",
)
