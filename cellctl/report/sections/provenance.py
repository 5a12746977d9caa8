"""Provenance of the figures: files and hashes, devices, versions, operator, and time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cellctl.files import InputError, parse_yaml
from cellctl.procedure.loader import read_procedure
from cellctl.report._page import ReportSection
from cellctl.report._run import Run
from cellctl.report.figures import plain

_TEMPLATE = """\
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


def build(run: Run) -> Mapping[str, Any]:
    """The provenance as pairs of name and text."""
    return {
        "run": _run(run),
        "files": _files(run),
        "devices": [_device(name, who) for name, who in run.state.identities.items()],
        "parameters": _parameters(run),
        "versions": list(run.state.started.versions.items()) if run.state.started else [],
    }


def _run(run: Run) -> list[tuple[str, str]]:
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
        ("journal", f"{state.last_seq} events"),
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


SECTION = ReportSection(id="provenance", title="Provenance", order=90, build=build, template=_TEMPLATE)
