"""The tracker campaign over the wires: GeoCOM, Modbus, EthernetKRL, all in lockstep."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cell_runs import ROOT, Ended, faults, run_here

from cellctl.engine import State
from cellctl.journal import InterlockChanged, read_journal
from procedures.steps.tracker.rows import FramesRow, MonumentsRow, PoseRow, TrackerVerdict

pytestmark = pytest.mark.campaign

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


def cell_of(folder: Path, simulate: str = "") -> Path:
    """A copy of the shipped cell with lines added to its `simulate:` section."""
    text = CELL.read_text().replace("../robots/", f"{ROOT}/procedures/robots/")
    text = text.replace("ethernet=rsi_ethernet.xml", f"ethernet={CELL.parent}/rsi_ethernet.xml")
    path = folder / "cell.yaml"
    path.write_text(text.rstrip() + "\n" + simulate)
    return path


def run(folder: Path, *settings: str, **values: object) -> Ended:
    """The campaign with few poses and these faults."""
    return run_here(procedure_of(folder, **values), cell_of(folder, faults(*settings) if settings else ""), folder)


def verdict_of(ended: Ended) -> TrackerVerdict:
    found = ended.journal.last(TrackerVerdict)
    assert found is not None, ended.outcome.error
    return found


@pytest.fixture(scope="module")
def ended(tmp_path_factory: pytest.TempPathFactory) -> Ended:
    return run(tmp_path_factory.mktemp("tracker"))


def test_the_campaign_brings_held_out_targets_nearer_to_their_places(ended: Ended) -> None:
    assert ended.outcome.state is State.FINISHED, ended.outcome.error
    found = verdict_of(ended)
    assert found.verdict == "better"
    assert found.targets is not None
    assert found.targets.before.rms > 5.0 * found.targets.after.rms
    assert 0.4 < found.targets.found_sigma / found.targets.predicted_sigma < 2.0
    assert ended.robot_is_held()


def test_each_pose_has_the_weather_and_the_temperature_of_the_plc(ended: Ended) -> None:
    rows = ended.journal.recorded(PoseRow)
    assert all(row.point.weather is not None and 900.0 < row.point.weather.pressure_hpa < 1100.0 for row in rows)
    assert all(row.arm_c is not None and row.point.levelled for row in rows)


def test_the_points_are_those_of_the_accuracy_profile_in_the_address(ended: Ended) -> None:
    row = ended.journal.recorded(PoseRow)[0]
    assert row.point.accuracy == "tdra6000"
    assert not row.point.noise_only
    assert np.trace(np.array(row.point.common)) > 0.0


def test_turned_axes_find_the_instrument_within_their_sigma_of_the_nominal_robot(ended: Ended) -> None:
    row = ended.journal.recorded(FramesRow)[0]
    assert max(row.station.sigma[:3]) < 3.0
    assert np.linalg.norm(np.array(row.station.matrix)[:3, 3] - [3400.0, -1200.0, 900.0]) < 40.0


def test_the_station_stood_still(ended: Ended) -> None:
    assert {row.verdict for row in ended.journal.recorded(MonumentsRow)} == {"still"}


@pytest.mark.long
def test_a_beam_that_is_broken_for_a_moment_is_aimed_again(tmp_path: Path) -> None:
    ended = run(tmp_path, "fault: tracker.beam_broken, event: tracker.measure, count: 120, for_ms: 4000")
    assert ended.outcome.state is State.FINISHED, ended.outcome.error
    assert verdict_of(ended).better


@pytest.mark.long
def test_a_reflector_that_is_lost_for_good_ends_the_run_and_the_robot_is_held(tmp_path: Path) -> None:
    ended = run(tmp_path, "fault: tracker.reflector_lost, event: tracker.measure, count: 120")
    assert ended.outcome.state is State.FAILED
    assert "tracker: " in str(ended.outcome.error)
    assert ended.robot_is_held()


@pytest.mark.long
@pytest.mark.parametrize(("fault", "interlock"), [("emergency_stop", "emergency_stop"), ("guard_open", "guard")])
def test_the_safety_chain_opened_in_motion_stops_the_robot(tmp_path: Path, fault: str, interlock: str) -> None:
    procedure = procedure_of(tmp_path)
    condition = {"emergency_stop": "emergency_stop_ok", "guard": "guard_closed"}[interlock]
    procedure.write_text(
        procedure.read_text().replace(f"condition: {condition}}}", f"condition: {condition}, on_break: abort}}")
    )
    cell = cell_of(tmp_path, faults(f"fault: safety.{fault}, event: robot.move, count: 30, after_ms: 300"))
    ended = run_here(procedure, cell, tmp_path)
    assert ended.outcome.state is not State.FINISHED
    assert ended.robot_is_held()
    changes = [entry.event for entry in read_journal(tmp_path / "run") if isinstance(entry.event, InterlockChanged)]
    assert (interlock, False) in [(event.interlock, event.holds) for event in changes]


@pytest.mark.long
def test_a_bumped_station_begins_a_new_session(tmp_path: Path) -> None:
    ended = run(
        tmp_path,
        "fault: station.bump, event: tracker.measure, count: 185, mm: 3, deg: 0.02",
        poses_fit=40,
        monuments_every=15,
    )
    assert ended.outcome.state is State.FINISHED, ended.outcome.error
    assert verdict_of(ended).sessions == ("1", "2")
    assert verdict_of(ended).better


@pytest.mark.long
def test_a_wrong_reflector_is_found_by_the_certified_distance(tmp_path: Path) -> None:
    ended = run(tmp_path, "fault: reflector.wrong, mm: 5")
    assert ended.outcome.state is State.FAILED
    assert "reflector constant" in str(ended.outcome.error)
    assert not ended.touches


@pytest.mark.long
def test_a_tilted_instrument_ends_the_run(tmp_path: Path) -> None:
    ended = run(tmp_path, "fault: tracker.tilt, event: tracker.measure, count: 120, arcmin: 10")
    assert ended.outcome.state is State.FAILED
    assert "level" in str(ended.outcome.error)


@pytest.mark.long
def test_a_broken_pressure_sensor_ends_the_run_at_the_next_update_of_the_weather(tmp_path: Path) -> None:
    ended = run(tmp_path, "fault: plc.sensor, sensor: 5, event: tracker.measure, count: 60")
    assert ended.outcome.state is State.FAILED
    assert "plc: " in str(ended.outcome.error)


@pytest.mark.long
def test_a_plc_that_is_gone_stops_the_robot(tmp_path: Path) -> None:
    procedure = procedure_of(tmp_path)
    procedure.write_text(procedure.read_text().replace("guard_closed}", "guard_closed, on_break: abort}"))
    cell = cell_of(tmp_path, faults("fault: plc.gone, event: tracker.measure, count: 120"))
    ended = run_here(procedure, cell, tmp_path)
    assert ended.outcome.state is not State.FINISHED
    assert ended.robot_is_held()
