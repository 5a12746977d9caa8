"""Operations of an analysis in a job's process: requests in JSON to calls."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cellctl.calibration.estimation.progress import Progress
from cellctl.console.worker import Tell


def understand(request: dict[str, Any], tell: Tell) -> dict[str, Any]:
    """`folder` → what its data are understood as."""
    from cellctl.operations.analyses import understand_analysis

    return understand_analysis(Path(request["folder"]), _progress(tell))


def fit(request: dict[str, Any], tell: Tell) -> dict[str, Any]:
    """`folder`, `settings` → how the fit ended."""
    from cellctl.operations.analyses import FitSettings, fit_analysis

    return fit_analysis(Path(request["folder"]), FitSettings(**request["settings"]), _progress(tell)).to_json()


def compensate(request: dict[str, Any], tell: Tell) -> dict[str, Any]:
    """`folder`, `number`, `program` → the compensated program."""
    from cellctl.operations.analysis_programs import ProgramRequest, compensate_analysis

    given = request["program"]
    program = ProgramRequest(**{**given, "files": tuple(given["files"])})
    return compensate_analysis(Path(request["folder"]), request["number"], program, _progress(tell))


def _progress(tell: Tell) -> Progress:
    return lambda doing, share: tell({"doing": doing, "share": share})
