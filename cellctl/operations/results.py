"""The result of a run: its folder, its result, the state of its table."""

from __future__ import annotations

from pathlib import Path

from cellctl.clock import calendar_time
from cellctl.engine import Outcome
from cellctl.files import InputError, Problem
from cellctl.journal import PushedTable, RunResult, RunState, fold, read_journal
from cellctl.journal.journal_file import FILE_NAME, LOCK_NAME

SIMULATOR_MEMORY = "simulated_cell.json"
"""File in the run folder that stores a simulated robot's position for a resumed run."""


OUTPUT_NAME = "output.txt"
"""File in the run folder with the output of a run that no terminal shows."""


_BEFORE_THE_JOURNAL = {LOCK_NAME, SIMULATOR_MEMORY, OUTPUT_NAME}


def never_began(folder: Path) -> bool:
    """Whether a run ended, or is, between making its folder and beginning its journal."""
    if not folder.is_dir() or (folder / FILE_NAME).exists():
        return False
    return {file.name for file in folder.iterdir() if not file.name.startswith(".")} <= _BEFORE_THE_JOURNAL


def new_run_folder(runs: Path, procedure: str) -> Path:
    """Make a folder for a new run, `sphere_selfcal-20261121T192433Z`, numbered if that exists.

    Raises InputError if it cannot be made.
    """
    stem = f"{procedure}-{calendar_time().replace('-', '').replace(':', '')}"
    try:
        runs.mkdir(parents=True, exist_ok=True)
        for number in range(1, 1000):
            folder = runs / (stem if number == 1 else f"{stem}-{number}")
            try:
                folder.mkdir()
            except FileExistsError:
                continue
            return folder
    except OSError as error:
        cure = "give another folder with --runs"
        raise InputError(Problem(str(runs), 0, 0, f"cannot hold a run: {error.strerror}", cure)) from error
    raise InputError(Problem(str(runs), 0, 0, f"holds 999 runs '{stem}' already", "give another folder with --runs"))


def result_of(folder: Path, outcome: Outcome, wall_s: float) -> RunResult:
    """The result of a run that this process ran."""
    error = str(outcome.error) if outcome.error else None
    known = {"state": outcome.state.value, "error": error, "simulated_s": outcome.seconds, "wall_s": wall_s}
    return RunResult.of(folder.name, fold(read_journal(folder)), **known)


def table_line(state: RunState, folder: Path, *, only_unproved: bool = False) -> str:
    """State of the table that the run pushed, and what to do if it may be active but not proved; may be empty."""
    table = PushedTable.of(state)
    if table is None or (only_unproved and not table.unproved_in_force):
        return ""
    if not table.unproved_in_force:
        return table.words()
    memory = folder / SIMULATOR_MEMORY
    cell = f"--cell {state.started.cell.path if state.started else 'CELL'}"
    cell += f" --state {memory}" if memory.exists() else ""
    look = f"look with `cellctl table show {cell}`; take it back with `cellctl table rollback {cell}`"
    return f"{table.words()}: {look}"
