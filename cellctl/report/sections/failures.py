"""The steps that failed, were interrupted, or needed more than one attempt."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cellctl.report._page import ReportSection
from cellctl.report._run import Run


def build(run: Run) -> Mapping[str, Any] | None:
    """As text; the run's own reason is not repeated."""
    steps = run.state.steps.values()
    failed = [(step.step, step.failure.text) for step in steps if step.failure is not None]
    texts = [f"{step}: {text}" if text not in run.reason else f"It happened in {step}." for step, text in failed]
    texts += [f"{step.step} had begun and did not end." for step in run.state.in_flight]
    repeated = [(step.step, f"{step.attempt} attempts") for step in steps if step.attempt > 1]
    return {"texts": texts, "repeated": repeated} if texts or repeated else None


SECTION = ReportSection(
    id="failures",
    title="Failed and repeated steps",
    order=10,
    build=build,
    template="""\
{% from "pairs.html" import pairs %}
{% for text in texts %}
<p class="complaint">{{ text }}</p>
{% endfor %}
{{ pairs(repeated) if repeated else "" }}
""",
)
