"""A run in the list of runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self, final

from cellctl.console.live.run import UNREADABLE, Snapshot
from cellctl.console.live.unexpected import unexpected
from cellctl.files import InputError, Problem
from cellctl.journal import JournalError, RunState, fold, read_journal
from cellctl.operations.run_summary import run_summary


@final
@dataclass(frozen=True, slots=True)
class RunRow:
    """A run in the list of runs.

    `summary`: as `cellctl show --json`; of an unreadable run only `run` and `state`. `active`: it is in progress.
    `problem`: why it cannot be read. `events`: number of the last event that it contains.
    """

    run: str
    folder: Path
    summary: Mapping[str, Any]
    active: bool = False
    problem: Problem | None = None
    events: int = 0

    @property
    def began(self) -> str:
        """When it began, UTC, ISO 8601; empty if unknown."""
        return str(self.summary.get("began") or "")

    @property
    def state(self) -> str:
        """Its state."""
        return str(self.summary["state"])

    @classmethod
    def of_folder(cls, folder: Path) -> Self:
        """By reading the whole journal, in any thread."""
        try:
            return cls._of(folder, fold(read_journal(folder)))
        except JournalError as error:
            return cls._unreadable(folder, Problem(str(error.path), 0, 0, error.what, error.cure))

    @classmethod
    def of_snapshot(cls, snapshot: Snapshot) -> Self:
        """By the state of a run that is followed, in the event loop."""
        if snapshot.problem and not snapshot.events:
            return cls._unreadable(snapshot.folder, snapshot.problem)
        return cls._of(snapshot.folder, snapshot.state, active=snapshot.active, problem=snapshot.problem)

    @classmethod
    def _of(cls, folder: Path, state: RunState, *, active: bool = False, problem: Problem | None = None) -> Self:
        try:
            return cls(folder.name, folder, run_summary(folder, state), active, problem, state.last_seq)
        except InputError as error:  # rows of another version
            return cls._unreadable(folder, error.problems[0])
        except Exception as error:
            return cls._unreadable(folder, unexpected(folder, error))

    @classmethod
    def _unreadable(cls, folder: Path, problem: Problem) -> Self:
        return cls(folder.name, folder, {"run": folder.name, "state": UNREADABLE}, problem=problem)
