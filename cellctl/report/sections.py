"""The sections that every run has: verdict, failures, identification, compensation table, provenance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from cellctl.files import InputError, parse_yaml
from cellctl.journal import PushedTable
from cellctl.procedure.loader import read_procedure
from cellctl.records import IdentificationRow, ResidualsRow
from cellctl.report._page import ReportSection
from cellctl.report._run import Run
from cellctl.report.budget import IDENTIFICATION, Sigma
from cellctl.report.figures import fit_lines, plain, significant
from cellctl.report.fit.page import identification_sections

_ENDS = {"failed": "failed", "aborted": "was aborted", "uncertain": "ended uncertain: a person has to look at the cell"}


def _verdict(run: Run) -> Mapping[str, Any]:
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


VERDICT_SECTION = ReportSection(
    id="verdict",
    title="",
    order=0,
    build=_verdict,
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


def _failures(run: Run) -> Mapping[str, Any] | None:
    """As text; the run's own reason is not repeated."""
    steps = run.state.steps.values()
    failed = [(step.step, step.failure.text) for step in steps if step.failure is not None]
    texts = [f"{step}: {text}" if text not in run.reason else f"It happened in {step}." for step, text in failed]
    texts += [f"{step.step} had begun and did not end." for step in run.state.in_flight]
    repeated = [(step.step, f"{step.attempt} attempts") for step in steps if step.attempt > 1]
    return {"texts": texts, "repeated": repeated} if texts or repeated else None


FAILURES_SECTION = ReportSection(
    id="failures",
    title="Failed and repeated steps",
    order=10,
    build=_failures,
    template="""\
{% from "pairs.html" import pairs %}
{% for text in texts %}
<p class="complaint">{{ text }}</p>
{% endfor %}
{{ pairs(repeated) if repeated else "" }}
""",
)


def _identification(run: Run) -> Mapping[str, Any] | None:
    """The sections of a fit; a note if an older run identified a model but stored no residuals."""
    residuals, found = run.state.last(ResidualsRow), run.state.last(IdentificationRow)
    if residuals is not None and found is not None:
        return {"stored": True, **identification_sections(residuals, found)}
    return {"stored": False} if run.figures else None


def _held_out_errors(run: Run) -> Sequence[float]:
    """Of the rows that the fit did not use."""
    found = run.state.last(IdentificationRow)
    return found.after if found and found.held_out else ()


IDENTIFICATION_SECTION = ReportSection(
    id="identification",
    title="Identification",
    order=50,
    build=_identification,
    errors=_held_out_errors,
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


_PREDICTIONS = {
    "predicted_before_mm": "predicted error before, mm",
    "predicted_after_mm": "predicted error after, mm",
    "sigma_mm": "predicted 1 σ of a target, mm",
}
_SMALLEST_MM = 1e-4


def _table(run: Run) -> Mapping[str, Any] | None:
    """None if no table was made or pushed."""
    pushed, content = PushedTable.of(run.state), run.table or {}
    if pushed is None and run.table is None:
        return None
    rows = [row for row in content.get("rows", []) if isinstance(row, Mapping)]
    name = pushed.row.id if pushed else content.get("id")
    pairs = [("identity", name), ("rows", pushed.row.rows if pushed else len(rows))]
    if pushed:
        pairs += [
            ("pushed", pushed.row.pushed),
            ("read back and equal", pushed.row.verified),
            ("in force", "not known" if pushed.row.active is None else pushed.row.active),
            ("largest correction of a joint, °", pushed.row.max_correction_deg),
            ("state", pushed.state),
        ]
    return {
        "pairs_": [(words, plain(value)) for words, value in pairs],
        "rows": len(rows),
        "predicted": _predicted(rows),
        "agrees": not content or name == content.get("id"),
    }


def _predicted(rows: Sequence[Mapping[str, Any]]) -> list[tuple[str, str, str]]:
    """Name, mean and maximum of each column of predictions that every row has."""
    columns = {words: [row.get(name) for row in rows] for name, words in _PREDICTIONS.items()}
    full = {words: [float(v) for v in values if isinstance(v, int | float)] for words, values in columns.items()}
    return [
        (words, _small(sum(values) / len(values)), _small(max(values)))
        for words, values in full.items()
        if values and len(values) == len(rows)
    ]


def _small(value: float) -> str:
    return significant(value) if value >= _SMALLEST_MM else f"< {_SMALLEST_MM:.4f}"


TABLE_SECTION = ReportSection(
    id="table",
    title="Compensation table",
    order=60,
    build=_table,
    sigmas=(
        Sigma(
            "predicted 1 σ of a target",
            "the position of the TCP at one target with the table in force",
            "covariance of the parameters, and the variance outside the measured joint region",
            "1 σ, 3-D",
        ),
    ),
    template="""\
{% from "pairs.html" import pairs %}
{{ pairs(pairs_) }}
{% if not agrees %}
<p class="complaint">table.json in the run folder has another id than the table that was pushed.</p>
{% endif %}
{% if predicted %}
<table>
<thead><tr><th>{{ rows }} rows of table.json</th><th>mean</th><th>max</th></tr></thead>
<tbody>
{% for words, mean, greatest in predicted %}
<tr><th>{{ words }}</th><td>{{ mean }}</td><td>{{ greatest }}</td></tr>
{% endfor %}
</tbody>
</table>
{% endif %}
""",
)


_PROVENANCE = """\
{% from "pairs.html" import pairs %}
{{ pairs(run) }}
{% if devices %}
<table class="words">
<thead><tr><th>device</th><th>model</th><th>serial</th><th>firmware</th><th></th></tr></thead>
<tbody>
{% for device in devices %}
<tr><th>{{ device.name }}</th><td>{{ device.model }}</td><td>{{ device.serial }}</td><td>{{ device.firmware }}</td>
<td>{{ "SIMULATED" if device.simulated else "real" }}</td></tr>
{% endfor %}
</tbody>
</table>
{% endif %}
<table class="words">
<thead><tr><th>file</th><th></th><th>SHA-256</th></tr></thead>
<tbody>
{% for what, name, digest in files %}
<tr><th>{{ what }}</th><td>{{ name }}</td><td class="hash">{{ digest }}</td></tr>
{% endfor %}
</tbody>
</table>
{% if parameters %}
<h3>Parameters of the procedure</h3>
<table class="words">
<tbody>
{% for name, value, help in parameters %}
<tr><th>{{ name }}</th><td>{{ value }}</td><td>{{ help }}</td></tr>
{% endfor %}
</tbody>
</table>
{% endif %}
{% if versions %}
<h3>Versions</h3>
{{ pairs(versions) }}
{% endif %}
"""


def _provenance(run: Run) -> Mapping[str, Any]:
    """The provenance as pairs of name and text."""
    return {
        "run": _run_facts(run),
        "files": _files(run),
        "devices": [_device(name, who) for name, who in run.state.identities.items()],
        "parameters": _parameters(run),
        "versions": list(run.state.started.versions.items()) if run.state.started else [],
    }


def _run_facts(run: Run) -> list[tuple[str, str]]:
    started, state = run.state.started, run.state
    if started is None:
        return []
    return [
        ("run", run.folder.resolve().name),
        ("began", started.calendar),
        ("lasted", f"{(state.last_ns - state.first_ns) * 1e-9:.1f} s of the cell's time"),
        ("operator", started.operator),
        ("clock", started.clock),
        ("seed", str(started.seed)),
        ("resumed", f"{state.resumed} times" if state.resumed else "never"),
        ("journal", f"{run.journal.events} events, digest of the last: {run.journal.digest or 'none'}"),
    ]


def _files(run: Run) -> list[tuple[str, str, str]]:
    """Kind, path, SHA-256."""
    started = run.state.started
    files = []
    if started is not None:
        files += [("procedure", started.procedure.path, started.procedure.sha256)]
        files += [("cell", started.cell.path, started.cell.sha256)]
        files += [("code", "cellctl, drivers, procedures", started.code_sha256)]
    if run.model is not None:
        files += [("robot file", run.model.robot.name, run.model.provenance.get("robot_sha256", ""))]
    return files + [("result", name, digest) for name, digest in run.hashes.items()]


def _device(name: str, who: Any) -> dict[str, Any]:
    known = {key: plain(who.get(key)) for key in ("model", "serial", "firmware")}
    return {"name": name, **known, "simulated": bool(who.get("simulated"))}


def _parameters(run: Run) -> list[tuple[str, str, str]]:
    """Name, value with its unit, and meaning, from the procedure file."""
    if run.state.started is None:
        return []
    source = run.state.started.procedure
    try:
        known = read_procedure(parse_yaml(source.text, source.path)).parameters
    except InputError:
        known = {}
    return [
        (name.replace("_", " "), f"{plain(value)} {of.unit if of else ''}".strip(), (of.help if of else "") or "")
        for name, value in run.state.parameters.items()
        for of in (known.get(name),)
    ]


PROVENANCE_SECTION = ReportSection(
    id="provenance", title="Provenance", order=90, build=_provenance, template=_PROVENANCE
)
