"""The outcome of the run and its verdict."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cellctl.report._page import ReportSection
from cellctl.report._run import Run
from cellctl.report.figures import fit_lines

_ENDS = {"failed": "failed", "aborted": "was aborted", "uncertain": "ended uncertain: a person has to look at the cell"}


def build(run: Run) -> Mapping[str, Any]:
    """State and sentence."""
    verdict = run.verdict
    return {
        "end": _end(run),
        "finished": run.word == "finished",
        "passed": verdict is not None and verdict.passed,
        "sentence": verdict.sentence if verdict else "",
        "below": verdict.lines if verdict else (),
        "points": run.state.measurements,
    }


def _end(run: Run) -> str:
    """`This run was aborted: …`."""
    words = _ENDS.get(run.word) or f"{'was' if run.word.startswith('cut') else 'is'} {run.word}"
    return f"This run {words}{': ' if run.reason else ''}{run.reason}"


SECTION = ReportSection(
    id="verdict",
    title="",
    order=0,
    build=build,
    error_lines=lambda run: fit_lines(run.figures),
    template="""\
<div class="verdict{{ '' if finished and passed else ' bad' }}">
{% if not finished %}
<p class="sentence">{{ end }}</p>
<p>{{ points }} measurements are recorded. The report shows what there is.</p>
{% endif %}
{% if sentence %}
<p class="sentence">{{ sentence }}</p>
{% for line in below %}
<p>{{ line }}</p>
{% endfor %}
{% elif finished %}
<p class="sentence">Finished, without a verdict: this procedure identifies nothing.</p>
{% endif %}
</div>
""",
)
