"""Faults and bad input of the tracker cell, one campaign over the wires each: how it ends, and what the user reads."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest

from cellctl.devices import DeviceError
from cellctl.engine import Mailbox, State
from cellctl.journal import InterlockChanged, StepEnded, fold, read_journal
from cellctl.operations.cell_devices import SimulatedCell
from cellctl.records import TableStateRow
from cellctl.report import write_report
from procedures.steps.tracker.rows import ConstantRow, MonumentsRow, PoseRow, ReturnRow, SetUpRow, TurnRow
from tests.helpers.runs import run_here
from tests.helpers.tracker import (
    assert_ended_safely,
    assert_resumable,
    cell_of,
    procedure_of,
    run,
    run_and_resume,
    started,
    told,
    verdict_of,
)

pytestmark = pytest.mark.campaign

Meanwhile = Callable[[Mailbox, SimulatedCell], Awaitable[None]]
HELD = "the robot is held: its controller confirmed that it stands still"
EARLY = "event: tracker.measure, count: 3"
"""In the warm-up."""


def failures(folder: Path, step: str) -> list[str]:
    """The texts of the failed attempts at steps whose path begins so."""
    ends = [entry.event for entry in read_journal(folder / "run") if isinstance(entry.event, StepEnded)]
    return [end.failure.text for end in ends if end.step.startswith(step) and end.failure]


def at(folder: Path, step: str, **fault: object) -> Meanwhile:
    """Lets the fault happen once a step whose path begins so was begun."""

    async def wait(mailbox: Mailbox, simulated: SimulatedCell) -> None:
        while not ((folder / "run" / "journal.sqlite").exists() and _begun(folder, step)):
            await asyncio.sleep(0.1)
        await simulated.tell({"op": "fault", **fault})

    return wait


def _begun(folder: Path, step: str) -> bool:
    journal = fold(read_journal(folder / "run"))
    assert journal.ended is None, f"the run ended before {step}"
    return started(journal, step)


# Beam


@pytest.mark.long
def test_a_beam_that_is_broken_for_a_moment_costs_an_attempt_and_nothing_else(tmp_path: Path, capsys: Any) -> None:
    ended = run(tmp_path, meanwhile=at(tmp_path, "rounds[0].poses[3]", fault="tracker.beam_broken", for_ms=4000))
    assert ended.outcome.state is State.FINISHED, ended.outcome.error
    assert any("tracker: " in text for text in failures(tmp_path, "rounds[0]"))
    rows = ended.journal.recorded(PoseRow)
    assert max(row.attempt for row in rows) > 1
    assert len(rows) == 36
    assert verdict_of(ended).better
    assert verdict_of(ended).ambiguous == 0
    assert told(ended, tmp_path, capsys).exit == 0


@pytest.mark.long
def test_a_reflector_that_is_lost_for_good_ends_the_run_after_three_attempts(tmp_path: Path, capsys: Any) -> None:
    ended = run(tmp_path, f"fault: tracker.reflector_lost, {EARLY}")
    end = told(ended, tmp_path, capsys)
    assert end.exit == 3
    assert "tracker: found no reflector" in end.stderr
    assert "check that nothing is between instrument and reflector" in end.stderr
    assert "in step warm_up" in end.stderr
    assert HELD in end.stderr
    assert len(failures(tmp_path, "warm_up")) == 3
    assert_ended_safely(ended)
    assert_resumable(tmp_path)


@pytest.mark.long
def test_a_reflector_that_is_lost_while_the_table_is_proved_takes_the_table_back(tmp_path: Path, capsys: Any) -> None:
    ended = run(tmp_path, meanwhile=at(tmp_path, "push", fault="tracker.reflector_lost"))
    end = told(ended, tmp_path, capsys)
    assert end.exit == 3
    assert "tracker: " in end.stderr
    assert "was rolled back: the table before it is in force again" in end.stderr
    assert len(ended.journal.recorded(TableStateRow)) >= 2
    assert_ended_safely(ended)
    assert_resumable(tmp_path)


# Safety chain, PLC, drives

BOTH = [
    ("emergency_stop", "emergency_stop", "KSS00001 EMERGENCY STOP"),
    pytest.param("guard_open", "guard", "KSS00207 Operator safety / safety fence open", marks=pytest.mark.long),
]


@pytest.mark.long
@pytest.mark.parametrize(("fault", "interlock", "message"), BOTH)
def test_the_safety_chain_opened_in_motion_pauses_the_run_until_a_person_ends_it(
    tmp_path: Path, capsys: Any, fault: str, interlock: str, message: str
) -> None:
    async def operator(mailbox: Mailbox, simulated: SimulatedCell) -> None:
        await until_paused(tmp_path)
        mailbox.abort()

    ended = run(tmp_path, f"fault: safety.{fault}, event: robot.move, count: 4, after_ms: 300", meanwhile=operator)
    end = told(ended, tmp_path, capsys)
    assert end.exit == 130
    assert HELD in end.stderr
    assert ended.states[-1]["Msg"] == message
    assert broken(tmp_path) == [interlock, "robot ready"]
    assert_ended_safely(ended)
    assert_resumable(tmp_path)


@pytest.mark.long
@pytest.mark.parametrize(
    ("fault", "interlocks"),
    [("safety.emergency_stop", ["emergency_stop", "robot ready"]), ("plc.gone", ["emergency_stop", "guard"])],
)
def test_once_the_cause_is_removed_the_run_goes_on_at_the_same_pose(
    tmp_path: Path, capsys: Any, fault: str, interlocks: list[str]
) -> None:
    async def operator(mailbox: Mailbox, simulated: SimulatedCell) -> None:
        await at(tmp_path, "rounds[0].poses[3]", fault=fault, for_ms=3000)(mailbox, simulated)
        await until_paused(tmp_path)
        if fault.startswith("safety"):
            await acknowledged(simulated)
        while paused(tmp_path):
            mailbox.resume()
            await asyncio.sleep(0.1)

    ended = run(tmp_path, meanwhile=operator)
    assert ended.outcome.state is State.FINISHED, ended.outcome.error
    assert broken(tmp_path) == interlocks
    assert len(ended.journal.recorded(PoseRow)) == 36
    assert verdict_of(ended).better
    assert told(ended, tmp_path, capsys).exit == 0


@pytest.mark.long
def test_a_run_that_was_aborted_while_the_emergency_stop_held_it_is_resumed_to_its_end(tmp_path: Path) -> None:
    async def operator(mailbox: Mailbox, simulated: SimulatedCell) -> None:
        await at(tmp_path, "rounds[0].poses[3]", fault="safety.emergency_stop", for_ms=3000)(mailbox, simulated)
        await until_paused(tmp_path)
        mailbox.abort()

    ended, finished, journal = run_and_resume(tmp_path, operator)
    assert ended.state is State.ABORTED
    assert finished.state is State.FINISHED, finished.error
    assert len(journal.recorded(PoseRow)) == 36


@pytest.mark.parametrize(
    ("fault", "cure"),
    [
        ("plc.gone", "check the network cable, the PLC's supply"),
        pytest.param("plc.stale", "set the PLC to RUN", marks=pytest.mark.long),
    ],
)
def test_a_plc_that_is_gone_or_stopped_stops_the_robot_and_states_what_to_check(
    tmp_path: Path, capsys: Any, fault: str, cure: str
) -> None:
    async def operator(mailbox: Mailbox, simulated: SimulatedCell) -> None:
        await until_paused(tmp_path)
        mailbox.abort()

    ended = run(tmp_path, f"fault: {fault}, {EARLY}", meanwhile=operator)
    assert told(ended, tmp_path, capsys).exit == 130
    texts = [event.text for event in changes(tmp_path) if not event.holds]
    assert any("plc: " in text and cure in text for text in texts)
    assert_ended_safely(ended)
    assert_resumable(tmp_path)


def test_a_sensor_of_the_air_that_is_broken_at_the_start_is_refused_before_any_motion(
    tmp_path: Path, capsys: Any
) -> None:
    ended = run(tmp_path, "fault: plc.sensor, sensor: 5")
    end = told(ended, tmp_path, capsys)
    assert end.exit == 3
    assert "plc: broken sensors: pressure" in end.stderr
    assert "check the sensor and its wire" in end.stderr
    assert "nothing was moved" in end.stderr
    assert_ended_safely(ended)


@pytest.mark.long
def test_a_sensor_of_the_air_that_breaks_ends_the_run_at_the_next_visit_to_the_nests(
    tmp_path: Path, capsys: Any
) -> None:
    settings = "fault: plc.sensor, sensor: 5, event: tracker.measure, count: 5"
    ended = run(tmp_path, settings)
    end = told(ended, tmp_path, capsys)
    assert end.exit == 3
    assert "plc: broken sensors: pressure" in end.stderr
    assert len(ended.journal.recorded(ReturnRow)) >= 6
    assert not ended.journal.recorded(MonumentsRow)
    assert_ended_safely(ended)
    assert_resumable(tmp_path)


@pytest.mark.long
def test_without_the_sensor_of_the_arm_the_campaign_is_done_without_its_temperature(
    tmp_path: Path, capsys: Any
) -> None:
    ended = run(tmp_path, "fault: plc.sensor, sensor: 3")
    assert ended.outcome.state is State.FINISHED, ended.outcome.error
    assert {row.arm_c for row in ended.journal.recorded(PoseRow)} == {None}
    assert verdict_of(ended).better


@pytest.mark.long
def test_a_drive_that_restarts_ends_the_run_and_is_named(tmp_path: Path, capsys: Any) -> None:
    ended = run(tmp_path, "fault: drives.reboot, node: 3, event: robot.move, count: 4")
    end = told(ended, tmp_path, capsys)
    assert end.exit == 3
    assert "drives: A3 (node 3) has restarted while it was in use" in end.stderr
    assert HELD in end.stderr
    assert_ended_safely(ended)
    assert_resumable(tmp_path)


@pytest.mark.long
def test_a_run_that_a_restarted_drive_ended_is_resumed_and_measures_no_pose_twice(tmp_path: Path) -> None:
    reboot = at(tmp_path, "rounds[0].poses[5]", fault="drives.reboot", node=3)
    ended, finished, journal = run_and_resume(tmp_path, reboot)
    assert ended.state is State.FAILED
    assert "drives: A3 (node 3)" in str(ended.error)
    assert finished.state is State.FINISHED, finished.error
    rows = journal.recorded(PoseRow)
    assert len(rows) == len({(row.number, row.direction) for row in rows}) == 36
    assert all(row.currents is not None for row in rows)
    assert finished.verdict is not None
    assert finished.verdict.better


# Nests, station, reflector


def nests_of_the_plate(folder: Path) -> Path:
    """The procedure with all three reflectors measured at each pose."""
    path = procedure_of(folder)
    text = path.read_text()
    assert 'fit: "${poses_fit}"' in text
    text = text.replace('fit: "${poses_fit}"', 'reflectors: 3, fit: "${poses_fit}"')
    before, mark, after = text.partition("- id: rounds")
    path.write_text(before + mark + after.replace('with: {pose: "${pose}"', 'with: {reflectors: 3, pose: "${pose}"', 1))
    return path


@pytest.mark.long
def test_a_reflector_of_the_plate_that_is_measured_twice_is_named(tmp_path: Path, capsys: Any) -> None:
    true = cell_of(tmp_path, name="true.yaml")
    cell = tmp_path / "cell.yaml"
    cell.write_text(true.read_text().replace("[120, 130, 0]", "[120, 20, 70]"))
    ended = run_here(nests_of_the_plate(tmp_path), cell, tmp_path, simulated_cell=true)
    end = told(ended, tmp_path, capsys)
    assert end.exit == 3
    assert "R2" in end.stderr
    assert "twice" in end.stderr
    assert not ended.journal.recorded(PoseRow)
    assert_ended_safely(ended)


@pytest.mark.long
def test_a_monument_nest_that_is_measured_twice_is_named(tmp_path: Path, capsys: Any) -> None:
    true = cell_of(tmp_path, name="true.yaml")
    cell = tmp_path / "cell.yaml"
    cell.write_text(true.read_text().replace("[1900, 1400, 300]", "[610, -1490, 400]"))
    ended = run_here(procedure_of(tmp_path), cell, tmp_path, simulated_cell=true)
    end = told(ended, tmp_path, capsys)
    assert end.exit == 3
    assert "nests N1 and N2 were measured" in end.stderr
    assert "correct their places in `station: nests:`" in end.stderr
    assert not ended.journal.recorded(TurnRow)
    assert_ended_safely(ended)


@pytest.mark.long
def test_a_bumped_station_begins_a_new_session_and_the_poses_of_that_round_are_left_out(
    tmp_path: Path, capsys: Any
) -> None:
    bump = at(tmp_path, "rounds[1].poses[3]", fault="station.bump", mm=3, deg=0.02)
    ended = run(tmp_path, meanwhile=bump, poses_fit=40, monuments_every=12)
    assert ended.outcome.state is State.FINISHED, ended.outcome.error
    found = verdict_of(ended)
    assert found.sessions == ("1", "2")
    assert found.ambiguous == 12
    assert "12 poses were measured while the station moved; they were left out." in found.lines
    assert [row.verdict for row in ended.journal.recorded(MonumentsRow)].count("moved") == 1
    assert found.better
    assert told(ended, tmp_path, capsys).exit == 0
    page = write_report(tmp_path / "run").read_text()
    assert "12 poses were measured while the station moved; they were left out." in page
    assert "Each motion begins a session." in page


@pytest.mark.long
def test_a_station_that_keeps_moving_ends_the_run(tmp_path: Path, capsys: Any) -> None:
    # 30 mm/h: half a millimetre from one visit to the next, which is 40 s later
    cell = cell_of(tmp_path, "  errors: {station_drift: 1000}\n")
    ended = run_here(procedure_of(tmp_path, monuments_every=5), cell, tmp_path)
    end = told(ended, tmp_path, capsys)
    assert end.exit == 3
    assert "tracker: its station is moving" in end.stderr
    assert "stand it firmly" in end.stderr
    assert_ended_safely(ended)


@pytest.mark.long
def test_an_instrument_that_is_tilted_beyond_its_compensator_ends_the_run(tmp_path: Path, capsys: Any) -> None:
    ended = run(tmp_path, f"fault: tracker.tilt, {EARLY}, arcmin: 10")
    end = told(ended, tmp_path, capsys)
    assert end.exit == 3
    assert "tracker: its compensator is out of its range" in end.stderr
    assert "level the instrument" in end.stderr
    assert all(row.point.levelled for row in ended.journal.recorded(ReturnRow))
    assert_ended_safely(ended)
    assert_resumable(tmp_path)


def test_an_instrument_that_is_not_levelled_at_the_start_is_refused_before_any_motion(
    tmp_path: Path, capsys: Any
) -> None:
    ended = run(tmp_path, "fault: tracker.tilt, arcmin: 10")
    end = told(ended, tmp_path, capsys)
    assert end.exit == 3
    assert "level the instrument" in end.stderr
    assert "nothing was moved" in end.stderr
    assert not ended.journal.recorded(SetUpRow)


@pytest.mark.long
def test_a_wrong_reflector_constant_is_found_before_any_pose_is_measured(tmp_path: Path, capsys: Any) -> None:
    ended = run(tmp_path, "fault: reflector.wrong, mm: 2")
    end = told(ended, tmp_path, capsys)
    assert end.exit == 3
    assert "the reflector constant is" in end.stderr
    assert "correct `constant_mm`" in end.stderr
    row = ended.journal.recorded(ConstantRow)
    assert not row  # of a failed step
    assert not ended.journal.recorded(TurnRow)
    assert not ended.journal.recorded(PoseRow)
    assert_ended_safely(ended)


@pytest.mark.long
def test_another_prism_that_is_set_at_the_instrument_during_the_run_is_not_taken_for_a_loose_nest(
    tmp_path: Path, capsys: Any
) -> None:
    other = at(tmp_path, "turns[0]", fault="tracker.wrong_prism", prism=1)
    ended = run(tmp_path, meanwhile=other, monuments_every=5)
    end = told(ended, tmp_path, capsys)
    assert end.exit == 3
    assert "every nest is measured 17.5" in end.stderr
    assert "another constant is set at the instrument" in end.stderr
    assert "loose" not in end.stderr
    assert_ended_safely(ended)


async def until_paused(folder: Path) -> None:
    """Returns once the run is paused."""
    while not paused(folder):
        await asyncio.sleep(0.05)


def paused(folder: Path) -> bool:
    """Whether the run is paused now."""
    return (folder / "run" / "journal.sqlite").exists() and fold(read_journal(folder / "run")).state == "paused"


async def acknowledged(simulated: SimulatedCell) -> None:
    """Acknowledge the controller's message at the pendant once its cause is gone."""
    while True:
        try:
            await simulated.tell({"op": "acknowledge", "device": "robot"})
        except DeviceError:
            await asyncio.sleep(0.05)
        else:
            return


def changes(folder: Path) -> list[InterlockChanged]:
    """Every change of an interlock in the journal."""
    return [entry.event for entry in read_journal(folder / "run") if isinstance(entry.event, InterlockChanged)]


def broken(folder: Path) -> list[str]:
    """The interlocks that broke, in order."""
    return [event.interlock for event in changes(folder) if not event.holds]
