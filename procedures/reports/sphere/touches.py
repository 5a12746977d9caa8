"""The touches of the identification by sphere, and those outside the measured joint region."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from cellctl.calibration import ErrorFigures
from cellctl.records import ResidualsRow
from cellctl.report import ReportSection, Run
from cellctl.report.figures import fixed
from cellctl.report.fit.residuals import Residuals
from procedures.steps.sphere.rows import TouchRow


def build(run: Run) -> Mapping[str, Any] | None:
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


SECTION = ReportSection(
    id="sphere-touches",
    title="Touches by sphere",
    order=30,
    needs=(TouchRow, ResidualsRow),
    build=build,
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
