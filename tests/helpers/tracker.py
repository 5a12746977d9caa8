"""Short tracker campaigns over the wires, and what the command line tells of their end."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from cellctl.cli.run_progress import exit_of, show_end
from cellctl.engine import Mailbox, NobodyWatching, Outcome
from cellctl.journal import RunState, fold, read_journal
from cellctl.operations.campaign import load_campaign
from cellctl.operations.cell_devices import SimulatedCell
from cellctl.operations.launch import Options, ResumedRun, resumed_run, run_on
from cellctl.operations.run_folder import result_of
from cellctl.records import TableStateRow
from procedures.steps.tracker.rows import TrackerVerdict
from tests.helpers.runs import ROOT, Ended, faults, run_here

PROCEDURE = ROOT / "procedures" / "tracker_calibration.yaml"
CELL = ROOT / "procedures" / "cells" / "tracker_cell.yaml"
FEW = {
    "poses_fit": 24,
    "poses_test": 8,
    "monuments_every": 20,
    "turn_points": 5,
    "samples": 2,
    "model": "geometry",
    "warm_up_minutes": 0.05,
    "warm_up_limit": 2,
}


def procedure_of(folder: Path, **values: object) -> Path:
    """The shipped procedure with other defaults."""
    text = PROCEDURE.read_text()
    for name, value in (FEW | values).items():
        before, mark, rest = text.partition(f"  {name}: {{")
        assert mark, name
        line, _, after = rest.partition("\n")
        head, _, tail = line.partition("default: ")
        text = f"{before}{mark}{head}default: {value},{tail.partition(',')[2]}\n{after}"
    path = folder / "tracker_calibration.yaml"
    path.write_text(text.replace("cells/tracker_cell.yaml", str(CELL)))
    return path


def cell_of(folder: Path, simulate: str = "", name: str = "cell.yaml") -> Path:
    """A copy of the shipped cell with lines added to its `simulate:` section."""
    text = CELL.read_text().replace("../robots/", f"{ROOT}/procedures/robots/")
    text = text.replace("ethernet=rsi_ethernet.xml", f"ethernet={CELL.parent}/rsi_ethernet.xml")
    path = folder / name
    path.write_text(text.rstrip() + "\n" + simulate)
    return path


def run(folder: Path, *settings: str, meanwhile: Any = None, **values: object) -> Ended:
    """The campaign with few poses and these faults."""
    cell = cell_of(folder, faults(*settings) if settings else "")
    return run_here(procedure_of(folder, **values), cell, folder, meanwhile=meanwhile)


def verdict_of(ended: Ended) -> TrackerVerdict:
    """The campaign's verdict."""
    found = ended.journal.last(TrackerVerdict)
    assert found is not None, ended.outcome.error
    return found


@dataclass(frozen=True)
class Told:
    """What the command line tells at the end of a run: exit code and stderr."""

    exit: int
    stderr: str


def told(ended: Ended, folder: Path, capsys: pytest.CaptureFixture[str]) -> Told:
    """Of a run that ended in `folder`."""
    capsys.readouterr()
    show_end(ended.outcome, result_of(folder / "run", ended.outcome, 0.0), folder / "run", quiet=True)
    return Told(int(exit_of(ended.outcome)), capsys.readouterr().err)


def assert_ended_safely(ended: Ended) -> None:
    """The robot is held, no table is in force, and the journal has an end and no step that is left open."""
    assert ended.outcome.held
    assert ended.robot_is_held()
    assert ended.outcome.troubles == ()
    assert ended.journal.ended is not None
    assert not ended.journal.in_flight
    assert not ended.journal.uncertain
    tables = ended.journal.recorded(TableStateRow)
    assert not tables or tables[-1].active is False


def assert_resumable(folder: Path) -> None:
    """`--resume` accepts the run, without a person's acknowledgement."""
    assert _to_resume(folder).state.finished


def _to_resume(folder: Path) -> ResumedRun:
    campaign = load_campaign(folder / "tracker_calibration.yaml", folder / "cell.yaml", [], resumed=True)
    return resumed_run(campaign, folder, folder / "run", [], acknowledged=False)


def run_and_resume(folder: Path, meanwhile: Any, **values: object) -> tuple[Outcome, Outcome, RunState]:
    """The campaign until a fault of `meanwhile` ends it, then resumed on the same cell; both ends, and the journal."""
    procedure, cell, run = procedure_of(folder, **values), cell_of(folder), folder / "run"

    async def go() -> tuple[Outcome, Outcome, RunState]:
        campaign = load_campaign(procedure, cell, [])
        simulated = await SimulatedCell.start(campaign.cell, None, None, ())
        try:
            mailbox = Mailbox()
            options = Options(None, None)
            first = asyncio.create_task(run_on(simulated, campaign, options, run, mailbox, NobodyWatching()))
            await meanwhile(mailbox, simulated)
            ended, again = await first, await asyncio.to_thread(_to_resume, folder)
            options = Options(again.seed, again.clock, resumed=again.state)
            finished = await run_on(simulated, again.campaign, options, run, Mailbox(), NobodyWatching())
        finally:
            simulated.stop()
        return ended, finished, fold(read_journal(run))

    return asyncio.run(go())


def started(journal: RunState, step: str) -> bool:
    """Whether a step whose path begins so was begun."""
    return any(path.startswith(step) for path in journal.steps)
