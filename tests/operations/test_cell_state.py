"""State of a cell: what the active run or the last examination reported, and `not known` for all else."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path

import pytest

from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.files import InputError, sha256_of
from cellctl.journal import (
    DeviceHealth,
    DevicesConnected,
    Journal,
    Outcome,
    RunEnded,
    RunStarted,
    SourceFile,
    StepEnded,
    StepFailure,
    StepStarted,
    fold,
    read_journal,
)
from cellctl.operations.cell_state import cell_state, examine_cell, last_examination, last_run_on, run_on
from cellctl.operations.doctor import Examination, Examined
from tests.helpers.runs import CELL

WHO = {"serial": "925185", "model": "KUKA KR5", "firmware": "8.6", "simulated": True}


@pytest.fixture(scope="module")
def cell() -> Cell:
    return Cell.load(CELL, DriverRegistry())


def journal_on(folder: Path, cell: Path = CELL) -> Journal:
    text = cell.read_text()
    source = SourceFile(str(cell), text, sha256_of(text))
    journal = Journal.create(folder, lambda: 0)
    journal.append(RunStarted(source, source, {}, 1, "lockstep", "me", "2026-01-02T03:04:05Z", "", {}))
    return journal


def failure(error: str, text: str) -> StepEnded:
    return StepEnded("touch", 1, Outcome.FAILED, None, StepFailure(error, text, "look at it"))


def test_without_run_and_examination_nothing_is_known(cell: Cell) -> None:
    state = cell_state(cell, None, None)
    assert {device.state for device in state.devices} == {"not known"}
    assert (state.emergency_stop, state.guard, state.mode, state.source) == (*["not known"] * 3, "")


def test_the_active_run_tells_identity_health_latency_last_error_and_the_safety_inputs(
    cell: Cell, tmp_path: Path
) -> None:
    inputs = {"emergency_stop_ok": False, "guard_closed": True}
    with journal_on(tmp_path / "run") as journal:
        journal.append(DevicesConnected({"robot": WHO, "probe": WHO}))
        journal.append(DeviceHealth("robot", True, "EXT, READY", 4.0, "EXT"))
        journal.append(DeviceHealth("probe", True, "well", None, "", inputs))
        journal.append(StepStarted("touch", 1, True))
        journal.append(failure("NoContact", "probe: nothing there\n    look at it"))
        journal.append(failure("DeviceLost", "robot: is silent"))
        assert run_on(CELL, tmp_path) == "run"
        state = cell_state(cell, ("run", fold(read_journal(tmp_path / "run"))), None)
    robot, probe = state.devices
    assert (robot.state, robot.last_error, robot.latency_ms, robot.serial) == ("failed", "is silent", 4.0, "925185")
    assert (probe.state, probe.last_error, probe.cure) == ("in order", "nothing there", "look at it")
    assert (state.emergency_stop, state.guard, state.mode) == ("open", "closed", "EXT")
    assert (state.source, state.at) == ("run run", "2026-01-02T03:04:05Z")
    assert run_on(CELL, tmp_path) == ""  # the run has ended


def test_after_a_run_the_cell_is_shown_as_that_run_saw_it_last_unless_it_was_examined_since(
    cell: Cell, tmp_path: Path
) -> None:
    well = Examined("robot", "", healthy=True, health="READY", latency_ms=4.0)
    doctor = Examination(cell.name, simulated=True, healthy=True, devices=(well,), at="2026-01-02T03:00:00Z")
    with journal_on(tmp_path / "run") as journal:
        journal.append(DevicesConnected({"robot": WHO, "probe": WHO}))
        journal.append(DeviceHealth("robot", True, "EXT, READY", 4.0, "EXT"))
        journal.append(DeviceHealth("robot", False, "EMERGENCY STOP", 4.0, "EXT", {"emergency_stop_ok": False}))
        journal.append(RunEnded("failed", "", "robot: EMERGENCY STOP", calendar="2026-01-02T03:10:00Z"))
    state = cell_state(cell, last_run_on(cell, tmp_path), doctor, active=False)
    assert (state.source, state.at, state.run) == ("run run", "2026-01-02T03:10:00Z", "")
    assert (state.devices[0].state, state.devices[0].text, state.emergency_stop) == ("failed", "EMERGENCY STOP", "open")
    later = cell_state(cell, last_run_on(cell, tmp_path), replace(doctor, at="2026-01-02T03:11:00Z"), active=False)
    assert (later.source, later.devices[0].state) == ("doctor", "in order")


def test_a_cell_is_not_examined_while_a_run_is_active_on_it(tmp_path: Path) -> None:
    with journal_on(tmp_path / "run"), pytest.raises(InputError, match="run run is active on this cell"):
        asyncio.run(examine_cell(CELL, tmp_path))


@pytest.mark.long
def test_an_examination_is_kept_and_shown_until_the_next_one(cell: Cell, tmp_path: Path) -> None:
    asyncio.run(examine_cell(CELL, tmp_path))
    state = cell_state(cell, None, last_examination(cell, tmp_path))
    assert [(device.name, device.state) for device in state.devices] == [("robot", "in order"), ("probe", "in order")]
    assert (state.mode, state.emergency_stop, state.source) == ("EXT", "not known", "doctor")
    assert state.at.endswith("Z")
