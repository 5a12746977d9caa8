"""A table that a run pushed and did not prove is out of force after it, and in force again where the run goes on."""

from __future__ import annotations

import asyncio
import re
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.engine import Mailbox, Outcome, State
from cellctl.formats import RobotFile, TableFile
from cellctl.formats.table import Row, TableRegion, TableRobot, TableSource
from cellctl.journal import RunState, StepStarted, fold, read_journal
from cellctl.operations.campaign import Campaign, load_campaign
from cellctl.operations.cell_devices import SimulatedCell
from cellctl.operations.launch import Options, run_on
from cellctl.operations.table_history import TableHistory
from cellctl.records import TablePushRow, TableStateRow
from tests.helpers.runs import CELL, PATIENCE_S, ROOT, cell_with, child, only_run, touches_procedure

pytestmark = pytest.mark.campaign

PUSHING = """
procedure: pushing
title: A table that was made before is pushed, and nothing proves it
parameters:
  table: {type: text}
steps:
  - {id: push, do: sphere.push, with: {table: "${table}"}, timeout: 60, on_resume: always}
  - {id: after, do: robot.stop, timeout: 60}
cleanup:
  - {id: hold, do: robot.stop, timeout: 15}
  - {id: withdraw, do: sphere.withdraw, timeout: 30}
"""

HOME = [0.0, -90.0, 90.0, 0.0, 45.0, 0.0]


def table_for(serial: str, shift: float) -> TableFile:
    """A table of one row for the shipped cell's simulated robot."""
    robot = RobotFile.load(Cell.load(CELL, DriverRegistry()).robot_file)
    row = Row(
        target=[900.0, 0.0, 600.0, 0.0, 0.0, 0.0],
        nominal=HOME,
        compensated=[angle + shift for angle in HOME],
        predicted_before_mm=1.0,
        predicted_after_mm=0.0,
        sigma_mm=0.05,
    )
    return TableFile.of(
        [row],
        robot=TableRobot(serial=serial, name=robot.name),
        simulated=True,
        tool=robot.tool,
        source=TableSource(run=None, model_sha256="0" * 64, method="pseudo-target"),
        joint_region=TableRegion(min=[-170.0] * 6, max=[170.0] * 6),
        created="2026-01-01T00:00:00Z",
    )


class AbortAt:
    """A watcher that aborts when this step begins."""

    def __init__(self, mailbox: Mailbox, step: str) -> None:
        self._mailbox, self._step = mailbox, step

    def event(self, event: Any) -> None:
        if isinstance(event, StepStarted) and event.step == self._step:
            self._mailbox.abort()

    def loop(self, path: str, index: int, count: int) -> None:
        pass


async def run_until(
    step: str, simulated: SimulatedCell, campaign: Campaign, run: Path, resumed: RunState | None = None
) -> Outcome:
    mailbox = Mailbox()
    options = Options(None, None, resumed=resumed)
    return await run_on(simulated, campaign, options, run, mailbox, AbortAt(mailbox, step))


def tables_of(eki: str) -> tuple[str | None, str | None]:
    """The ids of the active table and of the one before it, by the controller's own word."""
    host, _, port = eki.rpartition(":")
    text = ""
    with socket.create_connection((host, int(port)), timeout=PATIENCE_S) as line:
        line.sendall(b'<Cmd Id="1" Op="TSTATE"></Cmd>')
        while "</Rep>" not in text:
            received = line.recv(4096)
            assert received, "the controller closed the channel"
            text += received.decode()
    found = dict(re.findall(r'<(Active|Previous) Id="([^"]*)"', text))
    return found.get("Active"), found.get("Previous")


@pytest.mark.long
def test_an_abort_after_the_push_takes_the_table_back_and_a_resumed_run_puts_it_into_force_again(
    tmp_path: Path,
) -> None:
    procedure, cell = tmp_path / "pushing.yaml", cell_with(tmp_path)
    procedure.write_text(PUSHING)
    table, run = table_for("SIM-925185", 0.1), tmp_path / "run"
    run.mkdir()
    table.save(run / "table.json")

    async def go() -> list[Any]:
        campaign = load_campaign(procedure, cell, [f"table={table.id}"])
        simulated = await SimulatedCell.start(campaign.cell, None, None)
        eki = str(simulated.address("robot").query["eki"])
        try:
            first = await run_until("after", simulated, campaign, run)
            after_first = await asyncio.to_thread(tables_of, eki)
            second = await run_until("never", simulated, campaign, run, fold(read_journal(run)))
            return [first, after_first, second, await asyncio.to_thread(tables_of, eki)]
        finally:
            simulated.stop()

    first, after_first, second, after_second = asyncio.run(go())
    assert (first.state, second.state) == (State.ABORTED, State.FINISHED), (first.error, second.error)
    assert after_first == after_second == (None, table.id)
    rows = fold(read_journal(run)).all_recorded(TablePushRow, TableStateRow)
    assert [row.active for row in rows] == [None, True, False, None, True, False]
    changes, problems = TableHistory(tmp_path, "SIM-925185").read()
    assert problems == []
    assert [(each.begin.action, each.begin.table) for each in changes] == [("push", table.id), ("withdrawal", None)] * 2
    assert {(each.begin.run, each.result) for each in changes} == {("run", "in force")}


def test_kill_minus_nine_of_what_started_the_run_aborts_it_with_its_clean_up(tmp_path: Path) -> None:
    runs, procedure = tmp_path / "runs", touches_procedure(tmp_path, fit=40)
    cellctl_run = [sys.executable, "-m", "cellctl", "run", procedure, "--cell", cell_with(tmp_path), "--runs", runs]
    starting = "import subprocess, sys; subprocess.run(sys.argv[1:])"
    command = [sys.executable, "-c", starting, *map(str, cellctl_run)]
    with child(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True, cwd=ROOT) as parent:
        assert parent.stderr is not None
        while parent.poll() is None and not _touched(runs):
            time.sleep(0.1)  # noqa: TID251 - another process, in wall time
        parent.kill()
        said = parent.stderr.read()  # to the end of the run, which holds the other end
    assert f"process {parent.pid} (" in said
    assert "--detached" in said
    assert "the robot is held" in said
    state = fold(read_journal(only_run(runs)))
    assert (state.state, state.steps["cleanup.hold"].outcome) == ("aborted", "done")


def _touched(runs: Path) -> bool:
    journals = list(runs.glob("*/journal.sqlite"))
    return any(
        isinstance(entry.event, StepStarted) and entry.event.step.endswith("touch")
        for journal in journals
        for entry in read_journal(journal)
    )
