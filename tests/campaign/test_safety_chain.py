"""Emergency stop and guard, opened in a motion and in a search: the arm stops at once, and the campaign says why."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from cellctl.engine import Action, Operator, State
from cellctl.journal import InterlockChanged, fold, read_journal
from tests.helpers.runs import cellctl, faults, quick_cell, run_here, touches_procedure

pytestmark = pytest.mark.campaign

INTERLOCKS = """interlocks:
  - {id: emergency_stop, device: plc, condition: emergency_stop_ok, on_break: abort}
  - {id: guard, device: plc, condition: guard_closed, on_break: abort}
steps:
"""
PLC = {"devices:\n": "devices:\n  plc: modbus+tcp://192.168.10.5:502?unit=1\n"}
IN_MOTION = "event: robot.move, count: 2, after_ms: 300"
IN_SEARCH = "search: 2, after_ms: 400"


def watched(folder: Path, interlocks: str = INTERLOCKS) -> Path:
    procedure = touches_procedure(folder, fit=5)
    procedure.write_text(procedure.read_text().replace("steps:\n", interlocks, 1))
    return procedure


@pytest.mark.parametrize("when", [IN_MOTION, IN_SEARCH], ids=["motion", "search"])
@pytest.mark.parametrize(
    ("fault", "interlock", "message"),
    [
        ("safety.emergency_stop", "emergency_stop", "KSS00001 EMERGENCY STOP"),
        ("safety.guard_open", "guard", "KSS00207 Operator safety / safety fence open"),
    ],
)
def test_the_arm_stops_and_the_interlock_aborts_the_run(tmp_path, fault, interlock, message, when):
    cell = quick_cell(tmp_path, faults(f"fault: {fault}, {when}"), PLC)
    ended = run_here(watched(tmp_path), cell, tmp_path)
    assert ended.outcome.state is State.ABORTED, ended.outcome.error
    assert f"interlock '{interlock}' does not hold" in str(ended.outcome.error)
    assert ended.outcome.held
    assert ended.robot_is_held()
    assert ended.states[-1]["Msg"] == message
    assert ended.journal.ended is not None
    changes = [entry.event for entry in read_journal(tmp_path / "run") if isinstance(entry.event, InterlockChanged)]
    assert (interlock, False) in [(event.interlock, event.holds) for event in changes]
    ends = [entry.event for entry in read_journal(tmp_path / "run")]
    assert any("cleanup.hold" in str(event) for event in ends), "the clean-up ran"


def test_the_operator_reads_which_interlock_and_the_exit_code_is_3(tmp_path):
    cell = quick_cell(tmp_path, faults(f"fault: safety.guard_open, {IN_SEARCH}"), PLC)
    done = cellctl("run", watched(tmp_path), "--cell", cell, "--runs", tmp_path / "runs")
    assert done.returncode == 3, done.stderr
    assert "interlock 'guard' does not hold (plc: guard_closed)" in done.stderr + done.stdout


WAITING = "interlocks:\n" + "".join(
    f"  - {{id: {name}, device: plc, condition: {condition}, resume: RESUME}}\n"
    for name, condition in (("emergency_stop", "emergency_stop_ok"), ("guard", "guard_closed"))
)


@pytest.mark.parametrize(
    ("fault", "resume"),
    [
        ("safety.guard_open", "auto"),
        pytest.param("safety.guard_open", "operator", marks=pytest.mark.long),
        ("safety.emergency_stop", "auto"),
        pytest.param("plc.gone, for_ms: 3000", "auto", marks=pytest.mark.long),
        ("plc.stale, for_ms: 3000", "auto"),
    ],
)
def test_a_stopped_run_waits_for_the_reset_and_goes_on_at_the_same_touch(tmp_path, fault, resume):
    """Guard and emergency stop of this fault stay as they are until somebody resets the cell."""
    by_hand = "for_ms" not in fault

    async def operator(mailbox, simulated):
        while not (waiting := _waits(tmp_path / "run")):
            await asyncio.sleep(0.02)
        assert by_hand or waiting == "paused"
        while _paused(tmp_path / "run"):
            if by_hand:
                mailbox.post(Action("reset", Operator.here("test")))
            if resume == "operator":
                mailbox.resume()
            await asyncio.sleep(0.1)

    interlocks = WAITING.replace("RESUME", resume) + "steps:\n"
    cell = quick_cell(tmp_path, faults(f"fault: {fault}, {IN_SEARCH}"), PLC)
    ended = run_here(watched(tmp_path, interlocks), cell, tmp_path, meanwhile=operator)
    assert ended.outcome.state is State.FINISHED, ended.outcome.error
    rows = [row for row in ended.journal.rows if row.event.row_kind == "touch" and ended.journal.counts(row)]
    assert [row.event.step for row in rows] == [f"points[{number}].touch" for number in range(6)]
    assert ended.robot_is_held()


def _waits(run: Path) -> str:
    """`paused`, `finished` where the run went on by itself; empty before."""
    state = fold(read_journal(run)).state if (run / "journal.sqlite").exists() else ""
    return state if state in ("paused", "finished", "failed") else ""


def _paused(run: Path) -> bool:
    return (run / "journal.sqlite").exists() and fold(read_journal(run)).state == "paused"


def test_a_plc_that_is_gone_aborts_the_run_too(tmp_path):
    cell = quick_cell(tmp_path, faults(f"fault: plc.gone, {IN_SEARCH}"), PLC)
    ended = run_here(watched(tmp_path), cell, tmp_path)
    assert ended.outcome.state is State.ABORTED, ended.outcome.error
    assert "plc: " in str(ended.outcome.error)
    assert ended.robot_is_held()


@pytest.mark.long
def test_with_a_plc_polled_beside_it_the_same_seed_gives_the_same_rows(tmp_path):
    rows = []
    for name in ("first", "second"):
        folder = tmp_path / name
        folder.mkdir()
        ended = run_here(watched(folder), quick_cell(folder, "", PLC), folder)
        assert ended.outcome.state is State.FINISHED, ended.outcome.error
        rows.append(ended.touches)
    assert rows[0] == rows[1]
