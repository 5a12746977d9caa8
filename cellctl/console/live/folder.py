"""Finds the runs of a folder, and which of them have changed."""

from __future__ import annotations

from pathlib import Path
from typing import final

from cellctl.console.live.tail import Stamp, stamp, stamps
from cellctl.journal import writer_of
from cellctl.journal.journal_file import LOCK_NAME

RunStamp = tuple[Stamp, Stamp, Stamp]
"""Stamps of journal, write-ahead log and lock of a run."""


@final
class RunsFolder:
    """The runs in `path`, by name. An unchanged run costs three file stamps for each look."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._stamps: dict[str, RunStamp] = {}

    def look(self) -> tuple[list[str], list[str]]:
        """The runs that are new or have changed since the last look, the latest change first, and those that are gone.

        A folder that is missing or cannot be read has no runs.
        """
        now = dict(self._found())
        changed = [name for name, found in now.items() if found != self._stamps.get(name)]
        gone = [name for name in self._stamps if name not in now]
        self._stamps = now
        return sorted(changed, key=lambda name: _changed_ns(now[name]), reverse=True), gone

    def _found(self) -> list[tuple[str, RunStamp]]:
        try:
            folders = list(self._path.iterdir())
        except OSError:
            return []
        each = ((folder.name, (*stamps(folder), stamp(folder / LOCK_NAME))) for folder in folders)
        return [(name, found) for name, found in each if found[0]]


def is_written(run_folder: Path) -> bool:
    """Whether a process writes the run; call it only after the run has changed (see `JournalTail`)."""
    lock = stamp(run_folder / LOCK_NAME)
    return bool(lock and lock[1]) and writer_of(run_folder) is not None


def _changed_ns(found: RunStamp) -> int:
    return max(each[2] for each in found if each)
