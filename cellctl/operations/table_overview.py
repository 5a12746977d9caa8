"""The tables of all controllers of a folder of runs: their histories, and the tables that can be put in force."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cellctl.files import InputError
from cellctl.formats import TableFile
from cellctl.operations.table_history import TableHistory, histories

_TABLE = "table.json"


def table_overview(runs: Path) -> list[dict[str, Any]]:
    """Each controller with a history or a table of a run, with its tables, newest first.

    `serial`; `changes` as `cellctl table history --json`; `unreadable` lines; `tables`: id, rows, created, method, run,
    largest correction (deg).
    """
    files = _of_runs(runs)
    known = {history.serial: history for history in histories(runs)}
    serials = [*known, *sorted({file.robot.serial for file in files} - set(known))]
    return [
        _one(TableHistory(runs, serial), [file for file in files if file.robot.serial == serial]) for serial in serials
    ]


def _one(history: TableHistory, of_runs: list[TableFile]) -> dict[str, Any]:
    entries, problems = history.read()
    tables = {file.id: file for file in of_runs}
    for table_id in history.known():
        try:
            tables.setdefault(table_id, history.table(table_id))
        except InputError:  # a table of which only the record is left
            continue
    listed = sorted((_facts(file) for file in tables.values()), key=lambda facts: facts["created"], reverse=True)
    return {
        "serial": history.serial,
        "changes": [entry.to_json() for entry in reversed(entries)],
        "unreadable": [str(problem) for problem in problems],
        "tables": listed,
    }


def _facts(file: TableFile) -> dict[str, Any]:
    return {
        "id": file.id,
        "rows": len(file.rows),
        "created": file.created,
        "simulated": file.simulated,
        "robot": file.robot.name,
        "method": file.source.method,
        "run": file.source.run,
        "max_correction_deg": file.max_correction_deg,
    }


def _of_runs(runs: Path) -> list[TableFile]:
    """The tables of run folders; those that cannot be read are left out."""
    found = []
    for path in sorted(runs.glob(f"*/{_TABLE}")):
        try:
            found.append(TableFile.load(path))
        except InputError:
            continue
    return found
