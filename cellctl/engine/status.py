"""Status of a run that another process executes, from its journal alone."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import final

from cellctl.engine.step_count import StepCount, time_left_s
from cellctl.files import InputError, parse_yaml
from cellctl.journal import (
    Entry,
    InterlockChanged,
    Said,
    StateChanged,
    StepStarted,
    fold,
    read_journal,
    writer_of,
)
from cellctl.procedure import (
    BrokenSteps,
    StepRegistry,
    UnknownStep,
    expected_passes,
    phase_titles,
    read_procedure,
)


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


def status_of(run_folder: Path, registry: StepRegistry) -> Status:
    """Status of the run in `run_folder`. Raises JournalError."""
    writer = writer_of(run_folder)
    entries = list(read_journal(run_folder))
    state, now = fold(entries), _Now()
    for entry in entries:
        now.apply(entry)
    steps, titles, left_s = StepCount(state.finished), dict[str, str](), None
    if state.started:
        # written by a version with other rules or packages: the count is unknown
        with suppress(InputError, UnknownStep, BrokenSteps):
            procedure = read_procedure(parse_yaml(state.started.procedure.text, state.started.procedure.path))
            steps.count(procedure.steps, dict(state.parameters), "")
            titles = phase_titles(procedure, registry)
            left_s = time_left_s(entries, state, procedure, expected_passes(procedure, state.parameters, registry))
    under_way = [step.step for step in state.in_flight] if writer else []
    step = under_way[-1] if under_way else ""
    return Status(
        run=run_folder.name,
        state=state.state_if(running=bool(writer)),
        process=writer.pid if writer else None,
        step=step,
        phase=titles.get(step.rpartition(".")[2], ""),
        done=steps.done,
        total=steps.total,
        left_s=left_s if writer else None,
        message=now.message,
        confirm=now.asked.get(step, "") if now.kinds.get(step) == "confirm" else "",
        held_by=now.held_by if state.state == "paused" else "",
        broken=tuple(now.broken.values()),
    )


@final
@dataclass(slots=True)
class _Now:
    """Further facts from the events that the run's state does not contain."""

    message: str = ""
    held_by: str = ""
    kinds: dict[str, str] = field(default_factory=dict)
    asked: dict[str, str] = field(default_factory=dict)
    broken: dict[str, str] = field(default_factory=dict)

    def apply(self, entry: Entry) -> None:
        match entry.event:
            case StepStarted(step=step, do=do):
                self.kinds[step] = do
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
