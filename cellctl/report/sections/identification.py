"""The identified model, as on the page of a fit, from the rows that the identification stored."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cellctl.records import IdentificationRow, ResidualsRow
from cellctl.report._page import ReportSection
from cellctl.report._run import Run
from cellctl.report.budget import IDENTIFICATION
from cellctl.report.fit.page import identification_sections


def build(run: Run) -> Mapping[str, Any] | None:
    """The sections of a fit; a note if an older run identified a model but stored no residuals."""
    residuals, found = run.state.last(ResidualsRow), run.state.last(IdentificationRow)
    if residuals is not None and found is not None:
        return {"stored": True, **identification_sections(residuals, found)}
    return {"stored": False} if run.figures else None


SECTION = ReportSection(
    id="identification",
    title="Identification",
    order=50,
    build=build,
    sigmas=IDENTIFICATION,
    template="""\
{% if stored %}
{% set h = "h3" %}
{% include "identification.html" %}
{% else %}
<p>This run stored no residuals: it was made by an older version of cellctl. Its model and data set are in the run
folder; <code>cellctl fit ROBOT dataset.csv --artefact CELL --report fit.html</code> draws them.</p>
{% endif %}
""",
)
