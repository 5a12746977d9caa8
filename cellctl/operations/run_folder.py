"""The folder of a run: made for a new one, its files by name, and the state of its table."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import final

from cellctl.clock import calendar_time
from cellctl.files import InputError, Problem
from cellctl.journal import PushedTable, RunState, is_being_written
from cellctl.journal.journal_file import FILE_NAME, LOCK_NAME

SIMULATOR_MEMORY = "simulated_cell.json"
"""File in the run folder that stores a simulated robot's position for a resumed run."""

SIMULATOR_ERRORS = "simulated_cell.log"
"""File in the run folder with what simulators wrote that ended before the run: the traceback of an error."""


FAILURE_NAME = "failure.json"
"""Why a detached run did not begin or continue: a `Failure` as JSON, for the process that started it."""

OUTPUT_NAME = "output.txt"
"""File in the run folder with the output of a run that no terminal shows."""


_BEFORE_THE_JOURNAL = {LOCK_NAME, SIMULATOR_MEMORY, OUTPUT_NAME, FAILURE_NAME}


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


_LONGEST = 255
"""Bytes of a file's name."""

ACCEPTANCE_NAME = "acceptance.json"

_WORDS = {
    ACCEPTANCE_NAME: "decision on the acceptance limit",
    "dataset.csv": "measurements of the fit and the held-out ones",
    FILE_NAME: "the record of the run",
    "model.json": "the identified robot",
    "notes.jsonl": "notes of people on the run",
    "output.txt": "what the run printed",
    "report.html": "calibration report",
    "simulated_cell.json": "memory of the simulated controller",
    "table.json": "compensated joints",
    "tool.yaml": "the tool's line of a robot file",
}


@final
@dataclass(frozen=True, slots=True)
class RunFile:
    """A file of a run: name, size in bytes, what it is (empty if not known)."""

    name: str
    size: int
    what: str


def run_named(runs: Path, name: str) -> Path:
    """The folder of the run `name` in `runs`. Raises InputError if there is none by exactly this name."""
    place = runs / name
    with suppress(OSError):  # a name longer than a file's can be
        if _plain(name) and (place / FILE_NAME).is_file():
            return place
    raise InputError(Problem(name, 0, 0, "is the name of no run here", "choose one of the list of runs"))


def run_files(place: Path) -> list[RunFile]:
    """The files of the run in folder `place` by name, without hidden ones; the journal only when nobody writes it."""
    files = [path for path in sorted(place.iterdir()) if _readable(path)]
    if is_being_written(place):
        files = [path for path in files if path.name != FILE_NAME]
    return [RunFile(path.name, path.stat().st_size, _WORDS.get(path.name, "")) for path in files]


def run_file(place: Path, name: str) -> Path:
    """The file `name` of the run in folder `place`. Raises InputError unless `run_files` lists it."""
    if name in [file.name for file in run_files(place)]:
        return place / name
    raise InputError(Problem(name, 0, 0, f"is no file of run {place.name}", "choose one of its list of files"))


def _plain(name: str) -> bool:
    """Whether a name can be a file's, is not hidden, and has no folder in it."""
    short = len(name.encode(errors="replace")) <= _LONGEST
    return bool(name) and short and not name.startswith(".") and not set(name) & set("/\\\0")


def _readable(path: Path) -> bool:
    """Whether it is a file of its folder, and neither hidden, nor SQLite's own, nor a link."""
    own = ("-wal", "-shm", ".lock")
    return _plain(path.name) and not path.name.endswith(own) and path.is_file() and not path.is_symlink()
