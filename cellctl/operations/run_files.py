"""The files of a run folder that may be read from outside: by name alone, never above the folder of runs."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import final

from cellctl.files import InputError, Problem
from cellctl.journal import is_being_written
from cellctl.journal.journal_file import FILE_NAME

_LONGEST = 255
"""Bytes of a file's name."""

_WORDS = {
    "dataset.csv": "measurements of the fit and the held-out ones",
    FILE_NAME: "the record of the run",
    "model.json": "the identified robot",
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
