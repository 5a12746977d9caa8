"""The test by ISO 9283 on devices without wires: figures before and after, the cube, the registration."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cellctl.engine import State
from cellctl.files import InputError, load_yaml
from cellctl.procedure import CellFiles
from cellctl.records import TableStateRow
from cellctl.report import write_report
from procedures.steps.iso9283.planning import planned
from procedures.steps.iso9283.rows import CubeRow, IsoPoseRow, IsoRow, IsoVerdict, RegistrationRow
from procedures.steps.tracker.rows import PoseRow
from tests.helpers.own_model import Floats
from tests.helpers.steps import CELL, PROCEDURES, ROBOT, FakeRun, Truth, run_fake

PROCEDURE = PROCEDURES / "iso9283.yaml"
FEW: dict[str, Any] = {"cycles": 3, "registration_poses": 12}
CALIBRATION: dict[str, Any] = {
    "poses_fit": 30,
    "poses_test": 8,
    "monuments_every": 60,
    "model": "geometry",
    "turn_points": 5,
}


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of runs with a calibration."""
    folder = tmp_path_factory.mktemp("runs")
    done = run_fake(PROCEDURES / "tracker_calibration.yaml", folder, CALIBRATION, name="calibration")
    assert done.outcome.state is State.FINISHED, done.outcome.error
    return folder


@pytest.fixture(scope="module")
def compensated(runs: Path) -> FakeRun:
    return run_fake(PROCEDURE, runs, FEW | {"model_from": "calibration"}, name="compensated")


@pytest.fixture(scope="module")
def nominal(runs: Path) -> FakeRun:
    return run_fake(PROCEDURE, runs, FEW | {"reflectors": 1, "directions": False}, name="nominal")


def verdict_of(run: FakeRun) -> IsoVerdict:
    found = run.journal.last(IsoVerdict)
    assert found is not None, run.outcome.error
    return found


def true_error(truth: Truth, readings: Floats) -> Floats:
    """Distance P2 to P4 of the true robot's first reflector at the commanded joints (5, n), deg, mm."""
    places = []
    for joints in readings:
        truth.joints = joints
        places.append(truth.targets()["R1"][0])
    return np.asarray(np.linalg.norm(places[1] - places[3]))


@pytest.mark.long
def test_the_table_of_a_calibration_makes_the_five_points_better(compensated: FakeRun) -> None:
    found = verdict_of(compensated)
    assert compensated.outcome.state is State.FINISHED, compensated.outcome.error
    assert (found.verdict, found.passed) == ("better", True)
    assert found.iso9283.after is not None
    before, after = found.iso9283.before, found.iso9283.after
    assert min(each.accuracy for each in before.points) > 0.2
    assert max(each.accuracy for each in after.points) < 0.15
    assert abs(after.distance_accuracy) < 0.3 * abs(before.distance_accuracy)
    assert [row.active for row in compensated.journal.recorded(TableStateRow)] == [True]


def test_a_distance_error_is_that_of_the_true_robot(compensated: FakeRun) -> None:
    row = compensated.journal.recorded(CubeRow)[0]
    commanded = np.linalg.norm(np.subtract(row.points[1], row.points[3]))
    true = true_error(Truth.of(1), np.array(row.readings)) - commanded
    assert verdict_of(compensated).iso9283.before.distance_accuracy == pytest.approx(true, abs=0.1)


def test_three_reflectors_give_orientation_and_one_gives_position_only(compensated: FakeRun, nominal: FakeRun) -> None:
    with_plate, without = verdict_of(compensated).iso9283, verdict_of(nominal).iso9283
    assert all(each.of_angles is not None for each in with_plate.before.points)
    assert with_plate.after is not None
    assert max(abs(angle) for each in with_plate.after.points for angle in each.of_angles or ()) < 0.1
    assert all(each.of_angles is None and each.angle_repeatability is None for each in without.before.points)
    assert any("position only" in line for line in verdict_of(nominal).lines)


def test_without_a_model_the_robot_is_measured_by_nominal_joints_and_nothing_is_pushed(nominal: FakeRun) -> None:
    found = verdict_of(nominal)
    assert nominal.outcome.state is State.FINISHED, nominal.outcome.error
    assert (found.verdict, found.passed) == ("measured", True)
    assert found.after is None
    assert not nominal.robot.tables
    assert any("asks for 30 cycles" in line for line in found.lines)


def test_the_base_frame_is_registered_on_poses_that_are_not_judged(nominal: FakeRun) -> None:
    row = nominal.journal.recorded(RegistrationRow)[-1]
    poses = {tuple(each.commanded) for each in nominal.journal.recorded(PoseRow)}
    judged = {tuple(each.commanded) for each in nominal.journal.recorded(IsoPoseRow)}
    assert (row.by, row.poses) == ("nominal", 12)
    assert not poses & judged


def test_a_cycle_visits_five_points_and_three_of_them_from_three_directions(compensated: FakeRun) -> None:
    rows = [row for row in compensated.journal.recorded(IsoPoseRow) if row.when == "before" and row.cycle == 1]
    assert [row.place for row in rows if not row.side] == [0, 4, 3, 2, 1]
    assert [(row.place, row.side) for row in rows if row.side] == [(p, s) for p in (0, 1, 3) for s in (1, 2, 3)]
    assert len(verdict_of(compensated).iso9283.before.variation) == 3


def test_speed_and_load_are_recorded(compensated: FakeRun) -> None:
    found = verdict_of(compensated).iso9283
    assert (found.speed_percent, found.arrival_percent) == (30.0, 12.0)
    assert (found.load, found.payload_kg) == ("torch without wire", 0.0)


def test_the_instruments_own_repeatability_is_stated(nominal: FakeRun) -> None:
    """Of the fake instrument: 0.029 mm along the beam and 0.01 mm across: RP_l between 0.05 and 0.11 mm."""
    assert all(0.05 < each.instrument_rp < 0.11 for each in verdict_of(nominal).iso9283.before.points)


def test_the_report_has_the_table_and_the_scatter_of_the_five_points(compensated: FakeRun) -> None:
    page = write_report(compensated.folder).read_text()
    assert "iso-scatter" in page
    assert "vAP, mm" in page
    assert len(compensated.journal.recorded(IsoRow)) == 2


def test_the_model_of_another_controller_is_refused(runs: Path) -> None:
    text = (runs / "calibration" / "model.json").read_text()
    (runs / "stranger").mkdir()
    (runs / "stranger" / "model.json").write_text(text.replace('"robot_serial":"SIM-1"', '"robot_serial":"SIM-2"'))
    run = run_fake(PROCEDURE, runs, FEW | {"model_from": "stranger"}, name="refused")
    assert isinstance(run.outcome.error, InputError)
    assert "controller 'SIM-2'" in str(run.outcome.error)
    assert not run.robot.moves


def test_a_cube_that_does_not_fit_is_refused_before_the_run() -> None:
    with pytest.raises(InputError, match="smaller edge"):
        planned(CellFiles(load_yaml(CELL), ROBOT, 1), 1600.0, "649, 556, 759", 1)
    with pytest.raises(InputError, match="x, y, z in mm"):
        planned(CellFiles(load_yaml(CELL), ROBOT, 1), 400.0, "1, 2", 1)


def test_the_cube_is_about_the_stated_centre_with_one_orientation_and_its_points_on_the_diagonals() -> None:
    cube = planned(CellFiles(load_yaml(CELL), ROBOT, 1), 250.0, "649, 556, 570", 1)
    assert np.allclose(cube.points[0], [649.0, 556.0, 570.0])
    lengths = np.linalg.norm(cube.points[[1, 2]] - cube.points[[3, 4]], axis=1)
    assert np.allclose(lengths, 0.8 * 250.0 * np.sqrt(3.0))
