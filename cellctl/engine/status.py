"""Where a run is, from its journal alone, while another process runs it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, final

from cellctl.files import InputError, parse_yaml
from cellctl.journal import (
    Entry,
    InterlockChanged,
    RunState,
    Said,
    StateChanged,
    StepStarted,
    fold,
    read_journal,
    writer_of,
)
from cellctl.procedure import Action, If, Loop, UnresolvedReference, read_procedure, resolve, step_path


@final
@dataclass(frozen=True, slots=True)
class Status:
    """Where a run is.

    `state`: the engine's word, or `cut off while …`. `process`: who runs it, None where nobody does. `step`: the step
    under way. `done` of `total` steps, as far as the loops' lists are known yet. `left_s`: of the loop under way, in
    seconds of the cell's time, None where no pass of it is done. `message`: the last line for the operator. `confirm`:
    the text that waits to be confirmed. `held_by`: why the run is paused. `broken`: interlocks that do not hold.
    """

    run: str
    state: str
    process: str | None
    step: str
    done: int
    total: int
    left_s: float | None
    message: str
    confirm: str
    held_by: str
    broken: tuple[str, ...]


def status_of(run_folder: Path) -> Status:
    """Where the run in `run_folder` is. Raises JournalError."""
    writer = writer_of(run_folder)
    entries = list(read_journal(run_folder))
    state, now = fold(entries), _Now()
    for entry in entries:
        now.apply(entry)
    steps = _Steps(state, now.began_ns)
    if state.started:
        try:
            procedure = read_procedure(parse_yaml(state.started.procedure.text, state.started.procedure.path))
            steps.count(procedure.steps, dict(state.parameters), "")
        except InputError:  # written by a version with other rules: the count is not known
            pass
    under_way = [step.step for step in state.in_flight] if writer else []
    step = under_way[-1] if under_way else ""
    return Status(
        run=run_folder.name,
        state=state.state if writer or state.ended else f"cut off while {state.state}",
        process=writer.pid if writer else None,
        step=step,
        done=steps.done,
        total=steps.total,
        left_s=steps.left_s,
        message=now.message,
        confirm=now.asked.get(step, "") if now.kinds.get(step) == "confirm" else "",
        held_by=now.held_by if state.state == "paused" else "",
        broken=tuple(now.broken.values()),
    )


def running_in(runs: Iterable[Path]) -> list[Path]:
    """Those of the run folders that a process writes now."""
    return [folder for folder in runs if writer_of(folder)]


@final
@dataclass(slots=True)
class _Now:
    """What the events say beside the run's state."""

    message: str = ""
    held_by: str = ""
    began_ns: dict[str, int] = field(default_factory=dict)
    kinds: dict[str, str] = field(default_factory=dict)
    asked: dict[str, str] = field(default_factory=dict)
    broken: dict[str, str] = field(default_factory=dict)

    def apply(self, entry: Entry) -> None:
        match entry.event:
            case StepStarted(step=step, do=do):
                self.kinds[step] = do
                self.began_ns[step] = entry.time_ns
            case Said(text, step):
                self.message = text
                self.asked[step] = text
            case StateChanged(after=after, reason=reason):
                self.held_by = reason if after == "paused" else ""
            case InterlockChanged(interlock=name, holds=holds, text=text):
                self.broken.pop(name, None)
                if not holds:
                    self.broken[name] = text
            case _:
                pass


@final
class _Steps:
    """How many steps a run has, as far as its loops are known, and how many are done."""

    def __init__(self, state: RunState, began_ns: Mapping[str, int]) -> None:
        self.done = self.total = 0
        self.left_s: float | None = None
        self._state, self._finished, self._began_ns = state, state.finished, began_ns

    def count(self, actions: tuple[Action, ...], scope: dict[str, Any], outer: str) -> None:
        for action in actions:
            path = step_path(outer, action.id)
            if isinstance(action, Loop):
                self._loop(action, scope, outer)
                continue
            self.total += 1
            self.done += path in self._finished
            scope[action.id] = self._finished.get(path)
            if isinstance(action, If) and path in self._finished:
                branch = action.then if self._finished[path]["value"] else action.otherwise
                self.count(branch, dict(scope), path)

    def _loop(self, loop: Loop, scope: dict[str, Any], outer: str) -> None:
        try:
            values = resolve(loop.for_each, scope)
        except UnresolvedReference:  # the step that gives the list is not done yet
            return
        before, passes, counted = self.done, 0, self.total
        for index, value in enumerate(values):
            done, total = self.done, self.total
            self.count(loop.steps, {**scope, loop.variable: value}, step_path(outer, loop.id, index))
            passes += self.done - done == self.total - total
        if self.done > before and self.done - before < self.total - counted and passes:
            began = self._began_ns.get(self._first(step_path(outer, loop.id, 0)), self._state.last_ns)
            self.left_s = (self._state.last_ns - began) * 1e-9 / passes * (len(values) - passes)

    def _first(self, prefix: str) -> str:
        return next((path for path in self._began_ns if path.startswith(f"{prefix}.")), "")
