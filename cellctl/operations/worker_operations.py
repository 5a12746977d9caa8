"""Operations in a process of their own, called by `cellctl.operations.worker`: requests in JSON to calls.

Each takes a JSON object and what reports a line, and returns JSON.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from cellctl.calibration.identification.progress import Progress
from cellctl.calibration.verdict.fit import held_out_fold
from cellctl.files import write_atomically
from cellctl.operations.analyses import FitSettings, fit_analysis, understand_analysis
from cellctl.operations.analysis_programs import ProgramRequest, compensate_analysis
from cellctl.operations.export import Form, export_run
from cellctl.operations.fitting import requested_rows
from cellctl.operations.fold_processes import as_lists
from cellctl.operations.replay import replay_run
from cellctl.operations.results import as_json, from_json
from cellctl.operations.run_indexing import tell_existing_index
from cellctl.operations.table_actions import TableRequest, act, look
from cellctl.operations.worker import Tell
from cellctl.report import write_report


def understand(request: dict[str, Any], tell: Tell) -> dict[str, Any]:
    """`folder` → what its data are understood as."""
    return understand_analysis(Path(request["folder"]), _progress(tell))


def fit(request: dict[str, Any], tell: Tell) -> dict[str, Any]:
    """`folder`, `settings` → how the fit ended."""
    return as_json(fit_analysis(Path(request["folder"]), FitSettings(**request["settings"]), _progress(tell)))


def folds(request: dict[str, Any], tell: Tell) -> None:
    """The folds with the numbers `folds` of a fit (`fitting.fit_request`): tells each as it is done. It ends with the
    process that waits for them.
    """
    parent = os.getppid()
    measured, split = requested_rows(request)
    for number in request["folds"]:

        def told(doing: str, share: float, fold: int = number) -> None:
            if os.getppid() != parent:
                raise KeyboardInterrupt
            tell({"fold": fold, "doing": doing, "share": share})

        tell({"fold": number, "held_out": as_lists(held_out_fold(measured.task, split, number, told))})


def compensate(request: dict[str, Any], tell: Tell) -> dict[str, Any]:
    """`folder`, `number`, `program` → the compensated program."""
    given = request["program"]
    program = ProgramRequest(**{**given, "files": tuple(given["files"])})
    return as_json(compensate_analysis(Path(request["folder"]), request["number"], program, _progress(tell)))


def _progress(tell: Tell) -> Progress:
    return lambda doing, share: tell({"doing": doing, "share": share})


def replay(request: dict[str, Any], tell: Tell) -> dict[str, Any]:
    """Replay the run in the folder `place`."""
    place = Path(request["place"])
    return as_json(replay_run(place, lambda step: tell({"doing": f"computing {step}", "share": 0.0})))


def report(request: dict[str, Any], tell: Tell) -> dict[str, Any]:
    """Write the report of the run in the folder `place` again."""
    tell({"doing": "writing the report", "share": 0.0})
    place = Path(request["place"])
    file = write_report(place)
    tell_existing_index(place)
    return {"file": file.name}


def export(request: dict[str, Any], tell: Tell) -> dict[str, Any]:
    """Export the run in the folder `place` as `form` to the file `target`."""
    tell({"doing": f"exporting {request['form']}", "share": 0.0})
    found = export_run(Path(request["place"]), Form(request["form"]))
    write_atomically(Path(request["target"]), found.content)
    return {"samples": found.samples, "events": found.events, "missing": list(found.missing)}


def look_at_table(request: dict[str, Any], tell: Tell) -> dict[str, Any]:
    """What a `TableRequest` would change."""
    tell({"doing": "connecting to the controller", "share": 0.1})
    return as_json(look(from_json(TableRequest, request)))


def act_on_table(request: dict[str, Any], tell: Tell) -> dict[str, Any]:
    """Carry out a `TableRequest`."""
    tell({"doing": "connecting to the controller", "share": 0.1})
    return as_json(act(from_json(TableRequest, request)))
