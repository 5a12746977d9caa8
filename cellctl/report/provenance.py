"""Where the figures come from: files and hashes, devices, versions, who, when, and every attempt that failed."""

from __future__ import annotations

from typing import Any

from cellctl.report.numbers import plain
from cellctl.report.run import Run

Section = dict[str, Any]


def provenance(run: Run) -> Section:
    """All of it, as pairs of name and text."""
    return {
        "run": _run(run),
        "files": _files(run),
        "devices": [_device(name, who) for name, who in run.state.identities.items()],
        "parameters": [(name, plain(value)) for name, value in run.state.parameters.items()],
        "versions": list(run.state.started.versions.items()) if run.state.started else [],
        "retried": [(step.step, step.attempt) for step in run.state.steps.values() if step.attempt > 1],
        "mismatch": _mismatch(run),
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
    """What, where, SHA-256."""
    started = run.state.started
    files = []
    if started is not None:
        files += [("procedure", started.procedure.path, started.procedure.sha256)]
        files += [("cell", started.cell.path, started.cell.sha256)]
        files += [("code", "cellctl, drivers, procedures", started.code_sha256)]
    if run.model is not None:
        files += [("robot file", run.model.robot.name, run.model.provenance.get("robot_sha256", ""))]
    return files + [("result", name, digest) for name, digest in run.hashes.items()]


def _device(name: str, who: Any) -> Section:
    told = {key: plain(who.get(key)) for key in ("model", "serial", "firmware")}
    return {"name": name, **told, "simulated": bool(who.get("simulated"))}


def _mismatch(run: Run) -> list[str]:
    """Files in the folder that are not those that the model was made from."""
    if run.model is None:
        return []
    of_model, found = run.model.provenance, []
    data = of_model.get("data_sha256")
    if data and run.hashes.get("dataset.csv") not in (None, data):
        found.append("dataset.csv is not the file that the model was made from")
    cell = of_model.get("cell_sha256")
    if cell and run.state.started is not None and run.state.started.cell.sha256 != cell:
        found.append("the model was made with another cell file than the run's")
    return found
