"""Finished steps of a run and the time left, from its journal alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from typing import Any, final

from cellctl.clock import calendar_time
from cellctl.engine.passes import Passes
from cellctl.journal import Entry, RunResumed, RunStarted, RunState, StepStarted, fold
from cellctl.procedure import Action, If, Loop, Procedure, UnresolvedReference, resolve, step_path


@final
class StepCount:
    """How many steps a run has, as far as its loops are known, and how many are done.

    `loop(path, index, count)` is called for each loop that has begun, as `Watcher.loop`.
    """

    def __init__(self, finished: Mapping[str, Any], loop: Callable[[str, int, int], object] = lambda *_: None) -> None:
        self.done = self.total = 0
        self._finished, self._loop_begun = finished, loop

    def count(self, actions: tuple[Action, ...], scope: dict[str, Any], outer: str) -> None:
        """Add `actions` inside `outer`; `scope`: parameters, loop variables and results by name."""
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
        except UnresolvedReference:  # the step that returns the list is not done yet
            return
        path, passes = step_path(outer, loop.id), 0
        if self.done == self.total:  # all before it is done
            self._loop_begun(path, 0, len(values))
        for index, value in enumerate(values):
            done, total = self.done, self.total
            self.count(loop.steps, {**scope, loop.variable: value}, step_path(outer, loop.id, index))
            passes += total < self.total and self.done - done == self.total - total
        if passes:
            self._loop_begun(path, passes, len(values))


def time_left_s(entries: Sequence[Entry], state: RunState, procedure: Procedure, expected: int) -> float | None:
    """The wall time left, s, as `cellctl run` shows it; None if it is not known yet.

    `state`: of all `entries`; `expected`: see `Passes`.
    """
    begun = max(index for index, entry in enumerate(entries) if isinstance(entry.event, RunStarted | RunResumed))
    in_loops = (entry for entry in entries[begun:] if isinstance(entry.event, StepStarted) and "[" in entry.event.step)
    first = next(in_loops, None)
    if first is None:
        return None
    seconds = [first.time_ns * 1e-9]
    passes = Passes(expected, lambda: seconds[-1])
    for done in (fold(entries[: begun + 1]).finished, state.finished):
        steps = StepCount(done, passes.loop)
        steps.count(procedure.steps, dict(state.parameters), "")
        passes.step_begins()
        seconds.append(state.last_ns * 1e-9)
    pace = _wall_seconds_each(state, entries[begun].time_ns)
    return None if passes.left_s is None else passes.left_s * pace


def _wall_seconds_each(state: RunState, begun_ns: int) -> float:
    """Wall time for a second of the cell's time: 1, except in lockstep."""
    assert state.started is not None
    seconds = (state.last_ns - begun_ns) * 1e-9
    if state.started.clock != "lockstep" or seconds <= 0.0:
        return 1.0
    since, now = (datetime.fromisoformat(text) for text in (state.calendar, calendar_time()))
    return (now - since).total_seconds() / seconds
