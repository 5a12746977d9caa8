"""Status of a run that another process executes, from its journal alone: procedure, progress and time left."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Self, final

from cellctl.clock import calendar_time
from cellctl.engine.step_tree import Node, StepTree
from cellctl.files import InputError, parse_yaml
from cellctl.journal import (
    Entry,
    InterlockChanged,
    RunResumed,
    RunStarted,
    RunState,
    Said,
    StateChanged,
    StepEnded,
    StepStarted,
    Writer,
    read_journal,
    writer_of,
)
from cellctl.procedure import (
    BrokenSteps,
    Confirm,
    Loop,
    Procedure,
    Step,
    StepRegistry,
    UnknownStep,
    expected_passes,
    phase_titles,
    read_procedure,
)


@final
class PassTimes:
    """How long passes take, for each loop of the procedure, and the time for those that are left.

    A campaign's loops differ: a touch takes 6 s, a round of a proof a minute. One rate for all would promise too little
    or too much, and another time whenever a loop ends.
    """

    def __init__(self) -> None:
        self._taken: dict[str, tuple[int, float]] = {}

    def add(self, path: str, count: int, seconds: float) -> None:
        """Passes of the loop at `path` that took `seconds` together; a pause within one counts as `_LONGEST` passes."""
        kind = _INDEX.sub("", path)
        known, sum_ = self._taken.get(kind, (0, 0.0))
        if known >= _FEWEST:
            seconds = min(seconds, _LONGEST * count * sum_ / known)
        self._taken[kind] = known + count, sum_ + seconds

    def left_s(self, left: Mapping[str, int], further: int) -> float | None:
        """Seconds for the passes that are left, by their loop's path, and for `further` ones of loops to come.

        None while too few passes have been seen.
        """
        seen = sum(count for count, _ in self._taken.values())
        to_do = sum(left.values()) + further
        if not to_do or seen < min(_FEWEST, 0.5 * (seen + to_do)):
            return None
        mean = sum(seconds for _, seconds in self._taken.values()) / seen
        known = {kind: seconds / count for kind, (count, seconds) in self._taken.items()}
        return further * mean + sum(n * known.get(_INDEX.sub("", path), mean) for path, n in left.items())


_INDEX = re.compile(r"\[\d+\]")
_FEWEST = 3
"""Passes that show how long one takes."""
_LONGEST = 5.0
"""So many times the mean of the passes before one counts at most."""


@final
class Passes:
    """Passes through all loops of a run: done, total, and the time left by what passes of each loop took.

    expected: the steps' estimate before the run; raised if the loops have more passes. clock: seconds.
    """

    def __init__(self, expected: int, clock: Callable[[], float] = time.monotonic) -> None:
        self._expected, self._clock = expected, clock
        self._index: dict[str, int] = {}
        self._count: dict[str, int] = {}
        self._times = PassTimes()
        self._since: dict[str, tuple[float, int]] = {}
        self._began = False

    def loop(self, path: str, index: int, count: int) -> None:
        """As `Watcher.loop`; a loop that contains loops is not counted once those have begun."""
        around = path.rpartition("[")[0]
        self._index.pop(around, None)
        self._count.pop(around, None)
        self._since.pop(around, None)
        now = self._clock()
        since, before = self._since.get(path, (now, index))
        if self._began and index > before:
            self._times.add(path, index - before, now - since)
        self._since[path] = now, index
        if not any(inner.startswith(f"{path}[") for inner in self._index):
            self._index[path], self._count[path] = index, count

    def step_begins(self) -> None:
        """A step is executed, not skipped as already finished: time counts from the first one."""
        if not self._began:
            self._began = True
            self._since = {path: (self._clock(), index) for path, (_, index) in self._since.items()}

    @property
    def done(self) -> int:
        """Finished passes."""
        return sum(self._index.values())

    @property
    def total(self) -> int:
        """All passes known so far."""
        return max(self._expected, sum(self._count.values()))

    @property
    def left_s(self) -> float | None:
        """Seconds for the remaining passes; None if not known yet."""
        left = {path: self._count[path] - index for path, index in self._index.items()}
        return self._times.left_s(left, self.total - sum(self._count.values()))


@final
@dataclass(frozen=True, slots=True)
class KnownProcedure:
    """`titles`: action id → its own title; `phases`: step id → title of its phase; `expected`: see `Passes`."""

    procedure: Procedure
    titles: Mapping[str, str]
    phases: Mapping[str, str]
    expected: int

    @classmethod
    def of(cls, started: RunStarted, registry: StepRegistry) -> Self | None:
        """The procedure of a started run; None if it was written by a version with other rules.

        Of steps whose package is not installed here only the ids are known.
        """
        try:
            procedure = read_procedure(parse_yaml(started.procedure.text, started.procedure.path))
        except InputError:
            return None
        titles = _titles(procedure, registry)
        try:
            expected = expected_passes(procedure, started.parameters, registry)
            return cls(procedure, titles, phase_titles(procedure, registry), expected)
        except (UnknownStep, BrokenSteps):
            return cls(procedure, titles, {}, 0)
        except InputError:
            return None


def _title_of_kind(do: str, registry: StepRegistry) -> str:
    try:
        return registry.describe(do).title
    except (UnknownStep, BrokenSteps):
        return ""


def _titles(procedure: Procedure, registry: StepRegistry) -> dict[str, str]:
    titles = {}
    for action in procedure.actions():
        match action:
            case Confirm(text=text):
                title = text
            case Loop(title=title):
                pass
            case Step(do=do):
                title = _title_of_kind(do, registry)
            case _:
                title = ""
        titles[action.id] = title or action.id.replace("_", " ")
    return titles


@final
@dataclass(frozen=True, slots=True)
class Status:
    """Status of a run.

    `state`: the engine's, or `cut off while …`. `process`: the one that runs it, else None. `step`: the step in
    progress, `phase`: its title. `done` of `total` steps, as far as the loops' lists are known yet. `left_s`: of the
    whole run, in seconds of wall time, None if not known yet. `message`: the last line for the operator.
    `confirm`: the text that waits to be confirmed. `held_by`: why the run is paused. `broken`: interlocks that do not
    hold.
    """

    run: str
    state: str
    process: str | None
    step: str
    phase: str
    done: int
    total: int
    left_s: float | None
    message: str
    confirm: str
    held_by: str
    broken: tuple[str, ...]


def status_of(run_folder: Path, registry: StepRegistry) -> tuple[Status, RunState]:
    """Status of the run in `run_folder`, and the fold of its events. Raises JournalError."""
    writer = writer_of(run_folder)
    found = RunProgress(lambda started: KnownProcedure.of(started, registry))
    for entry in read_journal(run_folder):
        found.apply(entry)
    return found.status(run_folder.name, writer), found.state


@final
class RunProgress:
    """Status and tree of a run, updated event by event. `state`: the fold of its events.

    `known`: reads the procedure of a started run; None if this version cannot read it, then the steps are not counted.
    """

    def __init__(self, known: Callable[[RunStarted], KnownProcedure | None]) -> None:
        self.state = RunState()
        self._read = known
        self._known: KnownProcedure | None = None
        self._tree: StepTree | None = None
        self._now = _Now()
        self._pace = _Pace()

    def apply(self, entry: Entry) -> None:
        """Add one event."""
        interrupted = list(self._now.in_progress) if isinstance(entry.event, RunResumed) else []
        self.state.apply(entry)
        self._now.apply(entry)
        match entry.event:
            case RunStarted() as started:
                self._known = known = self._read(started)
                states = self.state.steps
                self._tree = StepTree(known.procedure, known.titles, started.parameters, states) if known else None
                self._pace.process_begins(entry.time_ns, self._tree)
            case RunResumed():
                self._changed(*interrupted)
                self._pace.process_begins(entry.time_ns, self._tree)
            case StepStarted(step=step):
                self._changed(step)
                self._pace.step_begins(step, entry.time_ns)
            case StepEnded(step=step):
                self._changed(step)
                self._pace.step_ends(entry.time_ns)
            case _:
                pass

    def status(self, run: str, writer: Writer | None) -> Status:
        """The status now. `run`: its name; `writer`: the process that executes it."""
        state, now, tree = self.state, self._now, self._tree
        step = next(reversed(now.in_progress), "") if writer else ""
        return Status(
            run=run,
            state=state.state_if(running=bool(writer)),
            process=writer.pid if writer else None,
            step=step,
            phase=self._known.phases.get(step.rpartition(".")[2], "") if self._known else "",
            done=tree.done if tree else 0,
            total=tree.total if tree else 0,
            left_s=self._pace.left_s(state, tree, self._known.expected) if writer and tree and self._known else None,
            message=now.message,
            confirm=now.asked.get(step, "") if now.in_progress.get(step) == "confirm" else "",
            held_by=now.held_by if state.state == "paused" else "",
            broken=tuple(now.broken.values()),
        )

    def tree(self, writer: Writer | None) -> Node | None:
        """The procedure as a tree; None if it is not known."""
        if self._tree is None:
            return None
        return self._tree.frozen(alive=bool(writer) and not self.state.ended, cleaning=self.state.state == "cleaning")

    def _changed(self, *steps: str) -> None:
        for step in steps:
            if self._tree:
                self._tree.changed(step)


@final
@dataclass(slots=True)
class _Now:
    """Further facts from the events that the run's state does not contain. `in_progress`: step → its kind."""

    message: str = ""
    held_by: str = ""
    in_progress: dict[str, str] = field(default_factory=dict)
    asked: dict[str, str] = field(default_factory=dict)
    broken: dict[str, str] = field(default_factory=dict)

    def apply(self, entry: Entry) -> None:
        match entry.event:
            case RunResumed():
                self.in_progress.clear()
            case StepStarted(step=step, do=do):
                self.in_progress[step] = do
            case StepEnded(step=step):
                self.in_progress.pop(step, None)
                self.asked.pop(step, None)
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
@dataclass(slots=True)
class _Pace:
    """The time that passes of loops take in the process that executes the run now."""

    begun_ns: int = 0
    times: PassTimes = field(default_factory=PassTimes)
    at: tuple[str, int, int] | None = None
    ended_ns: int = 0
    looped: bool = False
    seen: tuple[float, int] | None = None
    lockstep: tuple[float, float] = (0.0, 0.0)

    def process_begins(self, time_ns: int, tree: StepTree | None) -> None:
        if tree:
            tree.reach()
        self.begun_ns, self.times, self.at, self.looped = time_ns, PassTimes(), None, False
        self.seen, self.lockstep = None, (0.0, 0.0)

    def step_begins(self, step: str, time_ns: int) -> None:
        """A pass ends where the next one of its loop begins; the last one of a loop with its last step."""
        loop, _, rest = step.rpartition("[")
        index = int(rest.partition("]")[0]) if loop else -1
        if self.at and self.at[:2] != (loop, index):
            before, first, since_ns = self.at
            if before == loop:
                self.times.add(loop, index - first, (self.ended_ns - since_ns) * 1e-9)
            elif not loop.startswith(f"{before}["):
                self.times.add(before, 1, (self.ended_ns - since_ns) * 1e-9)
            self.at = None
        if loop and self.at is None:
            self.at = loop, index, self.ended_ns if self.looped else time_ns
            self.looped = True

    def step_ends(self, time_ns: int) -> None:
        self.ended_ns = time_ns

    def left_s(self, state: RunState, tree: StepTree, expected: int) -> float | None:
        """The wall time left, s, as `cellctl run` shows it; None if it is not known yet. `expected`: see `Passes`."""
        tree.reach()
        left = self.times.left_s(tree.passes_left(), max(expected - tree.passes_total, 0))
        return None if left is None else left * self._wall_seconds_each(state)

    def _wall_seconds_each(self, state: RunState) -> float:
        """Wall time for a second of the cell's time: 1, except in lockstep.

        There it is that of the passes that this process has seen, else that of the whole run: planning takes minutes,
        and no time of the cell.
        """
        assert state.started is not None
        seconds = (state.last_ns - self.begun_ns) * 1e-9
        if state.started.clock != "lockstep" or seconds <= 0.0:
            return 1.0
        now = time.monotonic()
        if self.seen and state.last_ns > self.seen[1]:
            wall, cell = self.lockstep
            self.lockstep = wall + min(now - self.seen[0], _MOST_S), cell + (state.last_ns - self.seen[1]) * 1e-9
        if self.seen is None or state.last_ns > self.seen[1]:
            self.seen = now, state.last_ns
        if self.lockstep[0] >= _ENOUGH_S:
            return self.lockstep[0] / self.lockstep[1]
        since, now_ = (datetime.fromisoformat(text) for text in (state.calendar, calendar_time()))
        return (now_ - since).total_seconds() / seconds


_ENOUGH_S = 5.0
"""Wall time that shows how fast a cell in lockstep is."""
_MOST_S = 5.0
"""Between two looks, more wall time is that of a pause or of a computation."""
