"""PLC and robot lost by one cause, and the process killed beside it: nothing moves again before a person looked."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from cellctl.files import parse_yaml
from cellctl.journal import InterlockChanged, RunResumed, StepStarted, fold, read_journal
from tests.helpers.runs import PATIENCE_S, ROOT, cellctl, child, faults, only_run, quick_cell

pytestmark = pytest.mark.campaign

SHIPPED = [
    "tracker_calibration",
    *(
        pytest.param(name, marks=pytest.mark.long)
        for name in ("daily_check", "iso9283", "pose_calibration", "sphere_by_tracker")
    ),
]
BOTH_LOST = (
    "fault: plc.gone, event: robot.move, count: 5",
    "fault: robot.restart, event: robot.move, count: 5, after_ms: 200",
)


def cell_that_loses_both(folder: Path, procedure: str) -> Path:
    """The procedure's own cell, whose PLC and controller are lost in the robot's fifth move."""
    file = ROOT / "procedures" / f"{procedure}.yaml"
    shipped = file.parent / parse_yaml(file.read_text(), str(file)).data["cell"]
    return quick_cell(folder, faults(*BOTH_LOST), shipped=shipped)


@pytest.mark.long
@pytest.mark.parametrize("procedure", SHIPPED)
def test_a_robot_that_is_not_confirmed_to_stand_moves_again_only_after_an_acknowledgement(
    tmp_path: Path, procedure: str
) -> None:
    cell = cell_that_loses_both(tmp_path, procedure)
    given = [procedure, "--cell", str(cell), "--runs", str(tmp_path / "runs")]
    ended = cellctl("run", *given)
    assert ended.returncode == 4, ended.stderr
    assert "has not confirmed that the robot stands" in ended.stderr
    assert "the PLC closed the connection" in ended.stderr
    not_moved_without_a_word(only_run(tmp_path / "runs"), given)


@pytest.mark.long
@pytest.mark.parametrize("procedure", SHIPPED)
def test_nor_does_a_run_that_is_killed_beside_it(tmp_path: Path, procedure: str) -> None:
    runs = tmp_path / "runs"
    given = [procedure, "--cell", str(cell_that_loses_both(tmp_path, procedure)), "--runs", str(runs)]
    with child([sys.executable, "-m", "cellctl", "run", *given], cwd=ROOT, stdout=subprocess.DEVNULL) as running:
        until = time.monotonic() + PATIENCE_S
        while not _plc_is_lost(runs):
            assert running.poll() is None
            assert time.monotonic() < until
            time.sleep(0.02)  # noqa: TID251 - another process, in wall time
        os.kill(running.pid, signal.SIGKILL)
        running.wait()
    not_moved_without_a_word(only_run(runs), given)


def _plc_is_lost(runs: Path) -> bool:
    journals = list(runs.glob("*/journal.sqlite"))
    events = (entry.event for entry in read_journal(journals[0].parent)) if journals else ()
    return any(isinstance(event, InterlockChanged) and not event.holds for event in events)


def not_moved_without_a_word(run: Path, given: list[str]) -> None:
    """Resuming is refused: it asks for a person who has looked, and begins no step."""
    assert fold(read_journal(run)).uncertain
    refused = cellctl("run", *given, "--resume", run)
    assert refused.returncode == 4, refused.stderr
    assert "--acknowledge" in refused.stderr
    later = [entry.event for entry in read_journal(run)]
    assert not any(isinstance(event, RunResumed) for event in later)
    assert fold(read_journal(run)).uncertain
    assert any(isinstance(event, StepStarted) and event.moves for event in later)
