"""A study in its folder: rows as they are computed, then Parquet and a page.

The folder belongs to one study file and one version of the code: with a changed one rows of both would be mixed.
"""

from __future__ import annotations

import platform
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, final

from cellctl.calibration.identification.progress import Progress
from cellctl.files import InputError, Problem, canonical_json, sha256_of, write_atomically
from cellctl.files.validated import read_json
from cellctl.journal.journal_file import WriterLock
from cellctl.operations.launch import code_hash
from cellctl.operations.studies.campaign_units import RUNS
from cellctl.operations.studies.row_table import parquet_of, refuse_without_parquet
from cellctl.operations.studies.runner import Compute, Measure, Row, as_line, computed, load
from cellctl.operations.studies.study_file import SEED, Study

ROWS, TABLE, PAGE, IDENTITY, LOCK = "rows.jsonl", "rows.parquet", "report.html", "study.json", "study.lock"

_CURE = "delete the folder, or give the study another name: its rows are then computed anew"


@final
@dataclass(frozen=True)
class StudyState:
    """A study whose units all have a row. before: rows that were there; now: rows of this call."""

    folder: Path
    units: int
    before: int
    now: int


def run_study(study: Study, studies: Path, compute: Compute, progress: Progress) -> StudyState:
    """Compute the rows that are not in the study's folder in `studies`; write rows, Parquet and page.

    Raises InputError for a folder of another version of the study or the code; JournalError while another process
    computes it.
    """
    refuse_without_parquet()
    folder = studies / study.content.name
    folder.mkdir(parents=True, exist_ok=True)
    lock = WriterLock.take(folder / LOCK)
    try:
        identity = _identity(study)
        _refuse_changed(folder, identity)
        there = {_unit_line(row, study) for row in load(folder / ROWS)}
        missing = [unit for unit in study.units if as_line(unit) not in there]
        try:
            if missing:
                measure = _measure(study, folder, identity["code"])
                computed(measure, missing, folder / ROWS, compute, partial(_told, progress), {})
            if study.content.keep == "none":  # also what a killed worker left
                shutil.rmtree(folder / RUNS, ignore_errors=True)
        finally:  # also of what an interrupted study has
            _write_results(study, folder, in_order(study, load(folder / ROWS)))
    finally:
        lock.release()
    return StudyState(folder, len(study.units), len(study.units) - len(missing), len(missing))


def _write_results(study: Study, folder: Path, rows: list[Row]) -> None:
    """Parquet and page of the rows, if there are any."""
    if not rows:
        return
    from cellctl.report.study import study_page  # here: matplotlib takes a second

    write_atomically(folder / TABLE, parquet_of(rows))
    content = study.content
    page = study_page(content.name, content.study, rows, study.varied, study.kind.plotted, len(study.units), SEED)
    write_atomically(folder / PAGE, page)


def _measure(study: Study, folder: Path, code: str) -> Measure:
    beside = str(Path(study.document.file).resolve().parent)
    return partial(by_same_code, code, study.kind.measure, beside, str(folder.resolve()), study.content.keep)


def by_same_code(code: str, measure: Measure, *given: str, **unit: Any) -> Mapping[str, Any]:
    """What `measure` gives, where this process has the code with this hash. Raises InputError for another code."""
    if _own_code() != code:
        what = "a worker has another version of cellctl, its drivers or steps than this computer"
        raise InputError(Problem(platform.node(), 0, 0, what, "install the same version there, and start it again"))
    return measure(*given, **unit)


@cache
def _own_code() -> str:
    return code_hash()


def _told(progress: Progress, unit: Row, done: int, count: int, seconds: float) -> None:
    progress(f"{done} of {count}", done / count)


def _unit_line(row: Row, study: Study) -> str:
    return as_line({name: row[name] for name in study.units[0] if name in row})


def in_order(study: Study, rows: list[Row]) -> list[Row]:
    """One row of each unit, in the order of the units."""
    found = {_unit_line(row, study): row for row in reversed(rows)}
    return [found[line] for unit in study.units if (line := as_line(unit)) in found]


def _identity(study: Study) -> dict[str, Any]:
    return {"study": sha256_of(study.content.model_dump(mode="json")), "code": code_hash()}


def _refuse_changed(folder: Path, identity: dict[str, Any]) -> None:
    file = folder / IDENTITY
    if not file.exists():
        write_atomically(file, canonical_json(identity) + "\n")
        return
    before = read_json(file, "identity of a study", _CURE)
    names = {"study": "the study file", "code": "the code of cellctl, its drivers or steps"}
    changed = [text for name, text in names.items() if before.get(name) != identity[name]]
    if changed:
        what = "has changed since these rows were computed"
        raise InputError([Problem(str(folder), 0, 0, f"{text} {what}", _CURE) for text in changed])
