"""Resumes a run: only with unchanged files and cell; from an uncertain state only after a person's acknowledgement."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast, final

from cellctl.devices import DeviceUncertain
from cellctl.devices.cell import ClockMode
from cellctl.files import InputError, Problem, sha256_of
from cellctl.journal import RunStarted, RunState, fold, read_journal, writer_of
from cellctl.operations.campaign import Campaign
from cellctl.operations.provenance import changed_sources, code_hash
from cellctl.operations.results import never_began, table_line


@final
@dataclass(frozen=True, slots=True)
class ResumedRun:
    """A run to resume: its folder, the campaign with its parameters, and its state."""

    folder: Path
    campaign: Campaign
    state: RunState
    seed: int
    clock: ClockMode


def resumed_run(campaign: Campaign, runs: Path, run: Path, settings: list[str], *, acknowledged: bool) -> ResumedRun:
    """The run in folder `run` (or `runs`/`run`), if it may be resumed.

    Raises InputError if there is nothing to resume, or procedure, cell, code or settings have changed;
    DeviceUncertain if a step that moves or writes was interrupted and not `acknowledged`; JournalError, also
    if a process still runs it.
    """
    folder = run if run.is_dir() else runs / run
    if writer := writer_of(folder):
        raise writer.error(folder)
    state = RunState() if never_began(folder) else fold(read_journal(folder))
    started = state.started
    if started is None:
        cure = f"start again: cellctl run {campaign.procedure.document.file}"
        raise InputError(_problem(folder, "ended before it began: nothing was moved", cure))
    if state.state == "finished":
        raise InputError(_problem(folder, "is finished: it cannot be resumed", "run the procedure anew"))
    line = table_line(state, folder)
    changed = _changes(campaign, started, settings)
    if changed:
        cure = "run the procedure anew, or put back what it was"
        cure += f"\n    {line}" if line else ""
        raise InputError([_problem(folder, text, cure) for text in changed])
    if (uncertain := uncertainty(state)) and not acknowledged:
        raise DeviceUncertain("cell", uncertain, _LOOK + (f"\n    {line}" if line else ""))
    same = replace(campaign, parameters=dict(started.parameters))
    return ResumedRun(folder, same, state, started.seed, cast("ClockMode", started.clock))


_LOOK = (
    "Go and look: is the robot clear, does it stand where it did? Then say so with --acknowledge. Where it has been "
    "moved by hand off its planned way, the next step refuses to move it."
)


def _changes(campaign: Campaign, started: RunStarted, settings: list[str]) -> list[str]:
    changed = []
    if sha256_of(campaign.procedure.text) != started.procedure.sha256:
        changed.append(f"the procedure {started.procedure.path} has changed since")
    if sha256_of(campaign.cell.document.text) != started.cell.sha256:
        changed.append(f"the cell file {started.cell.path} has changed since")
    if started.robot and sha256_of(campaign.cell.robot_file.read_text(encoding="utf-8")) != started.robot.sha256:
        changed.append(f"the robot file {started.robot.path} has changed since")
    if code_hash() != started.code_sha256:
        changed.append(f"the code of cellctl, its drivers or steps has changed since{changed_sources(started.sources)}")
    for setting in settings:
        name = setting.partition("=")[0]
        if campaign.parameters.get(name) != started.parameters.get(name):
            changed.append(f"parameter {name} was {started.parameters.get(name)!r} in this run")
    return changed


def uncertainty(state: RunState) -> str:
    """What is uncertain about the cell after a run that nobody runs, as text; empty if nothing is."""
    if not state.uncertain:
        return ""
    moving = [step.step for step in state.steps.values() if step.moves and step.outcome in (None, "interrupted")]
    if moving:
        return f"the run was cut off in {', '.join(moving)}, which moves or writes: what it did last is not known"
    if (failed := state.unconfirmed) and not state.ended:
        return f"the run was cut off after {failed} had failed, before its devices were known to stand"
    cause = state.ended.reason.partition("\n")[0] if state.ended and state.ended.reason else "its clean-up failed"
    return f"the run ended in an uncertain state: {cause}"


def _problem(folder: Path, what: str, cure: str) -> Problem:
    return Problem(str(folder), 0, 0, f"this run {what}" if not what.startswith(("the ", "parameter")) else what, cure)
