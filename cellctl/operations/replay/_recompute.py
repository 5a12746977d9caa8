"""Repeats a run's computing steps: files, rows, identities, date and seed come from the journal alone."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, final

from cellctl.clock import WallClock
from cellctl.engine import Context, Surround
from cellctl.files import InputError, Problem, canonical_json, load_yaml, parse_yaml
from cellctl.journal import (
    Entry,
    KnownEvent,
    Outcome,
    Recorded,
    RunStarted,
    RunState,
    SourceFile,
    StepEnded,
    StepFailure,
    StepStarted,
)
from cellctl.procedure import BrokenSteps, Procedure, StepRegistry, UnknownStep, inputs_of, read_procedure
from cellctl.procedure.model import step_at
from cellctl.records import ArtefactRow, ComputingTimesRow


@final
@dataclass(frozen=True)
class Attempt:
    """The result of an attempt at a computing step: its end, and the rows that it recorded, including files.

    contents: name → content of the files, if known.
    """

    ended: StepEnded
    rows: tuple[Recorded, ...]
    contents: dict[str, bytes] = field(default_factory=dict)

    @property
    def artefacts(self) -> dict[str, ArtefactRow]:
        """The files by name."""
        rows = [ArtefactRow.read(row.data, row.version) for row in self.rows if row.row_kind == ArtefactRow.KIND]
        return {row.name: row for row in rows}

    @property
    def values(self) -> dict[str, Any]:
        """Result, failure and rows as JSON, without files, and without times, which no computer repeats."""
        kept = [row for row in self.rows if row.row_kind not in (ArtefactRow.KIND, ComputingTimesRow.KIND)]
        failure = self.ended.failure
        value = {
            "outcome": self.ended.outcome.value,
            "result": self.ended.result,
            "failure": failure and {"error": failure.error, "text": failure.text, "cure": failure.cure},
            "rows": [{"kind": row.row_kind, "version": row.version, "data": row.data} for row in kept],
        }
        content: dict[str, Any] = json.loads(canonical_json(value))
        return content


@final
@dataclass(frozen=True)
class Recomputed:
    """A step's attempt, recorded in the journal and computed now."""

    do: str
    recorded: Attempt
    now: Attempt


@contextmanager
def sources_of(started: RunStarted) -> Iterator[Sources]:
    """The run's source files, written from its first event into a temporary folder.

    Raises InputError if the journal lacks one of them, or the procedure cannot be read.
    """
    if started.robot is None:
        what = "was made by a version of cellctl that did not keep all source files in the journal"
        raise InputError(Problem(started.name or "this run", 0, 0, what, "it cannot be replayed; run it anew"))
    procedure = read_procedure(parse_yaml(started.procedure.text, started.procedure.path))
    if procedure.problems:
        raise InputError(procedure.problems)
    with TemporaryDirectory(prefix="cellctl-replay-") as name:
        folder = Path(name)
        (folder / "run").mkdir()
        cell, robot = _written(started.cell, folder / "cell"), _written(started.robot, folder / "robot")
        yield Sources(started, procedure, cell, robot, folder / "run")


def _written(source: SourceFile, folder: Path) -> Path:
    folder.mkdir()
    path = folder / Path(source.path).name
    path.write_bytes(source.text.encode())
    return path


@final
@dataclass(frozen=True, slots=True)
class Sources:
    """Procedure, cell and robot file at the start of the run, and an empty run folder."""

    started: RunStarted
    procedure: Procedure
    cell: Path
    robot: Path
    run: Path

    def surround(self) -> Surround:
        """The data that all steps share; without devices."""
        return Surround(WallClock(), self.started.seed, self.run, load_yaml(self.cell), self.robot, {}, recomputed=True)

    def with_original_paths(self, text: str) -> str:
        """A message with the paths of the run's own files."""
        assert self.started.robot is not None
        return text.replace(str(self.cell), self.started.cell.path).replace(str(self.robot), self.started.robot.path)


async def recomputed(
    entries: Sequence[Entry], sources: Sources, registry: StepRegistry, tell: Callable[[str], None]
) -> list[Recomputed]:
    """Every attempt at a computing step that was done or failed, repeated in the journal's order.

    Each gets the rows that existed when it began, and the files that the replay has made so far. `tell` is called
    with the name of each step before it begins. Raises InputError if a step kind is not installed.
    """
    state, found = RunState(), []
    for entry in entries:
        state.apply(entry)
        event = entry.event
        if not isinstance(event, StepStarted) or not _computes(event, registry):
            continue
        recorded = _recorded(event, entries)
        if recorded:
            tell(event.step)
            found.append(Recomputed(event.do, recorded, await _again(event, state, recorded, sources, registry)))
    return found


def _computes(event: StepStarted, registry: StepRegistry) -> bool:
    """Whether the step computes; `if` and `confirm` are the engine's own and have no family."""
    if event.moves or "." not in event.do:
        return False
    try:
        return registry.find(event.do).computes
    except (UnknownStep, BrokenSteps) as error:
        raise InputError(Problem(event.step, 0, 0, str(error), "install the package that has this step")) from error


def _recorded(started: StepStarted, entries: Sequence[Entry]) -> Attempt | None:
    """This attempt in the journal; None if it was interrupted, cancelled or timed out."""
    key = (started.step, started.attempt)
    events = [entry.event for entry in entries if isinstance(entry.event, StepEnded | Recorded)]
    mine = [event for event in events if (event.step, event.attempt) == key]
    ended = next((event for event in mine if isinstance(event, StepEnded)), None)
    if ended is None or ended.outcome not in (Outcome.DONE, Outcome.FAILED):
        return None
    return Attempt(ended, tuple(event for event in mine if isinstance(event, Recorded)))


async def _again(
    event: StepStarted, state: RunState, recorded: Attempt, sources: Sources, registry: StepRegistry
) -> Attempt:
    own = replace(state, steps=dict(state.steps), rows=list(state.rows), _read={})
    rows: list[Recorded] = []
    contents: dict[str, bytes] = {}

    def append(added: KnownEvent) -> None:
        own.apply(Entry(own.last_seq + 1, own.last_ns, added))
        if isinstance(added, Recorded):
            rows.append(added)
            if added.row_kind == ArtefactRow.KIND:
                name = ArtefactRow.read(added.data).name
                contents[name] = (sources.run / name).read_bytes()

    kind = registry.find(event.do)
    context = Context(event.step, event.attempt, sources.surround(), frozenset(), own, append)
    try:
        step, scope = step_at(sources.procedure, event.step, state.parameters, state.finished)
        result = kind.dump_result(await kind(context, inputs_of(sources.procedure, step, kind, scope)))
        ended = StepEnded(event.step, event.attempt, Outcome.DONE, result)
    except Exception as error:  # any error is the attempt's result, and is compared with the run's
        failure = _as_recorded(StepFailure.of(error), recorded.ended.failure, sources)
        ended = StepEnded(event.step, event.attempt, Outcome.FAILED, None, failure)
    return Attempt(ended, tuple(rows), contents)


def _as_recorded(failure: StepFailure, recorded: StepFailure | None, sources: Sources) -> StepFailure:
    """The recorded failure if this one differs only in the path of the run folder; else this one."""
    text = sources.with_original_paths(failure.text)
    pattern = ".*?".join(re.escape(piece) for piece in text.split(str(sources.run)))
    same = recorded and (recorded.error, recorded.cure) == (failure.error, failure.cure)
    if same and recorded and re.fullmatch(pattern, recorded.text, re.DOTALL):
        return recorded
    return replace(failure, text=text)
