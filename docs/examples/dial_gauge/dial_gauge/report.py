"""The section of the report about the readings."""

from __future__ import annotations

from typing import Any

from cellctl.report import ReportSection, Run, Sigma
from dial_gauge.steps import LengthRow


def build(run: Run) -> dict[str, Any]:
    """What the template shows."""
    rows = run.state.recorded(LengthRow)
    return {"rows": rows, "minutes": (rows[-1].time_s - rows[0].time_s) / 60.0}


SECTION = ReportSection(
    id="dial-gauge",
    title="Readings of the dial gauge",
    order=45,
    needs=(LengthRow,),
    build=build,
    template="""\
<p>{{ rows | length }} readings ± 0.001 mm in {{ "%.1f" | format(minutes) }} minutes.</p>
<table>
<tr><th>reading</th><th>mm</th></tr>
{% for row in rows %}<tr><td>{{ row.number }}</td><td>{{ "%.3f" | format(row.mm) }}</td></tr>
{% endfor %}</table>
""",
    sigmas=(Sigma("± of the readings", "a reading", "the gauge's maker", "1 σ"),),
)
