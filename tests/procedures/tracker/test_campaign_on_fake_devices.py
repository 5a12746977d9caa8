"""The whole tracker campaign on devices without wires: what is recorded, and what ends it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cellctl.engine import State
from cellctl.records import TableStateRow
from procedures.steps.tracker.rows import (
    CompensatedRow,
    ConstantRow,
    FramesRow,
    MonumentsRow,
    PoseRow,
    ReturnRow,
    TargetsRow,
    TrackerVerdict,
    WarmUpRow,
)
from tests.helpers.steps import CELL, PROCEDURES, FakeRun, Faults, Truth, run_fake

PROCEDURE = PROCEDURES / "tracker_calibration.yaml"
FEW: dict[str, Any] = {"poses_fit": 30, "poses_test": 10, "monuments_every": 12, "model": "geometry", "turn_points": 5}


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> FakeRun:
    return run_fake(PROCEDURE, tmp_path_factory.mktemp("good"), FEW)


def verdict_of(run: FakeRun) -> TrackerVerdict:
    found = run.journal.last(TrackerVerdict)
    assert found is not None, run.outcome.error
    return found


def test_the_table_brings_held_out_targets_to_their_places(good: FakeRun) -> None:
    found = verdict_of(good)
    assert good.outcome.state is State.FINISHED, good.outcome.error
    assert found.verdict == "better"
    assert found.targets is not None
    assert found.targets.before.mean > 0.5
    assert found.targets.after.mean < 0.1
    assert found.targets.n == good.journal.recorded(TargetsRow)[0].rows >= 8
    assert 0.5 < found.targets.found_sigma / found.targets.predicted_sigma < 1.5


def test_the_proved_table_stays_in_force(good: FakeRun) -> None:
    tables = good.journal.recorded(TableStateRow)
    assert tables[-1].active
    assert good.robot.tables[-1].id == tables[-1].id


def test_poses_are_measured_from_the_stated_side_and_a_share_from_both(good: FakeRun) -> None:
    rows = [row for row in good.journal.recorded(PoseRow) if row.set == "fit"]
    sides = [row.direction for row in rows]
    assert len(rows) == 34
    assert sides.count((1,) * 6) == 30
    assert sides.count((-1,) * 6) == 4
    moves = [np.array(each) for each in good.robot.moves]
    for row in rows:
        arrivals = [place for place, joints in enumerate(moves) if np.allclose(joints, row.commanded)]
        assert any(np.allclose(np.sign(moves[at] - moves[at - 1]), row.direction) for at in arrivals)


def test_half_of_the_held_out_poses_come_after_all_others(good: FakeRun) -> None:
    sets = [row.set for row in good.journal.recorded(PoseRow)]
    assert sets[-5:] == ["test"] * 5
    assert sets[:-5].count("test") == 5
    held_out = {row.number for row in good.journal.recorded(PoseRow) if row.set == "test"}
    left_out = set(good.journal.recorded(TargetsRow)[0].left_out)
    assert {row.number for row in good.journal.recorded(CompensatedRow)} == held_out - left_out


def test_each_point_has_weather_covariance_currents_and_temperature(good: FakeRun) -> None:
    row = good.journal.recorded(PoseRow)[0]
    assert row.point.weather is not None
    assert row.currents is not None
    assert row.arm_c == 25.0
    assert np.trace(np.array(row.point.covariance)) > np.trace(np.array(row.point.common)) > 0.0


def test_turned_axes_register_the_instrument_far_better_than_the_cell_file(good: FakeRun) -> None:
    true = Truth.of(1)
    row = good.journal.recorded(FramesRow)[0]
    found = np.array(row.station.matrix)
    assert np.linalg.norm(found[:3, 3] - true.station[:3, 3]) < 3.0
    off = [np.linalg.norm(np.array(place) - true.on_flange["R1"]) for place in (row.rough, row.reflector)]
    assert np.linalg.norm(true.station[:3, 3] - [3400.0, -1200.0, 900.0]) > 5.0
    assert off[1] < 2.0
    assert row.outliers == 0
    assert row.gravity_deg is not None


def test_monuments_and_return_pose_are_visited_before_between_and_after_the_poses(good: FakeRun) -> None:
    visits = good.journal.recorded(MonumentsRow)
    assert [row.when for row in visits] == ["start", *["during"] * 4, "end"]
    assert {row.verdict for row in visits} == {"still"}
    warm = good.journal.recorded(WarmUpRow)[0]
    assert warm.settled
    assert len(good.journal.recorded(ReturnRow)) == warm.returns + 1 + 5


@pytest.mark.long
def test_a_broken_beam_is_measured_again_and_the_retry_is_recorded(tmp_path: Path) -> None:
    ended = run_fake(PROCEDURE, tmp_path, FEW, faults=Faults(lost={45, 46}))
    assert ended.outcome.state is State.FINISHED, ended.outcome.error
    assert max(row.attempt for row in ended.journal.recorded(PoseRow)) == 3
    assert len(ended.journal.recorded(PoseRow)) == 44


def test_a_beam_that_is_lost_for_good_ends_the_run_with_the_cure(tmp_path: Path) -> None:
    ended = run_fake(PROCEDURE, tmp_path, FEW, faults=Faults(lost=set(range(45, 999))))
    assert ended.outcome.state is State.FAILED
    assert "clear the line of sight" in str(ended.outcome.error)
    assert ended.tracker.aims == 47


@pytest.mark.long
def test_a_bumped_station_begins_a_new_session_and_the_poses_around_it_are_left_out(tmp_path: Path) -> None:
    ended = run_fake(PROCEDURE, tmp_path, FEW | {"poses_fit": 40}, faults=Faults(bump_at={55: 2.0}))
    assert ended.outcome.state is State.FINISHED, ended.outcome.error
    found = verdict_of(ended)
    assert found.sessions == ("1", "2")
    assert found.ambiguous == 12
    assert found.verdict == "better"
    assert found.after is not None
    assert found.after.mean is not None
    assert found.after.mean < 0.15
    moved = [row for row in ended.journal.recorded(MonumentsRow) if row.verdict == "moved"]
    assert [row.shift_mm for row in moved] == [pytest.approx(2.0, abs=0.3)]


@pytest.mark.long
def test_a_station_that_is_bumped_in_a_visit_is_visited_again(tmp_path: Path) -> None:
    ended = run_fake(PROCEDURE, tmp_path, FEW, faults=Faults(bump_at={66: 2.0}))
    assert ended.outcome.state is State.FINISHED, ended.outcome.error
    assert verdict_of(ended).sessions == ("1", "2")


def test_a_station_that_keeps_moving_ends_the_run(tmp_path: Path) -> None:
    ended = run_fake(PROCEDURE, tmp_path, FEW, faults=Faults(bump_at={40: 2.0, 60: 2.0}))
    assert ended.outcome.state is State.FAILED
    assert "is moving" in str(ended.outcome.error)
    assert "stand it firmly" in str(ended.outcome.error)


def test_a_wrong_reflector_constant_is_found_by_the_distance_between_nests(tmp_path: Path) -> None:
    truth = Truth.of(1)
    truth.constant_mm = 2.0
    ended = run_fake(PROCEDURE, tmp_path, FEW, truth=truth)
    assert ended.outcome.state is State.FAILED
    found = ended.journal.all_recorded(ConstantRow)[0]
    assert found.wrong
    assert abs(found.error_mm - 2.0) < 4.0 * found.sigma_mm < 0.2
    assert "mm too large" in str(ended.outcome.error)
    assert "correct `constant_mm`" in str(ended.outcome.error)


@pytest.mark.parametrize(
    ("faults", "words"),
    [
        (Faults(unlevelled=True), "level it and switch the compensator on"),
        (Faults(two_face_mm=0.3), "two-face error 0.300 mm at point 1 is above 0.1 mm"),
    ],
)
def test_an_instrument_that_is_not_in_order_is_refused_before_any_pose(
    tmp_path: Path, faults: Faults, words: str
) -> None:
    ended = run_fake(PROCEDURE, tmp_path, FEW, faults=faults)
    assert ended.outcome.state is State.FAILED
    assert words in str(ended.outcome.error)
    assert not ended.journal.recorded(PoseRow)


def test_a_controller_that_corrects_its_own_geometry_is_refused(tmp_path: Path) -> None:
    text = CELL.read_text().replace("absolute_accuracy: false", "absolute_accuracy: true")
    cell = tmp_path / "cell.yaml"
    cell.write_text(text)
    ended = run_fake(PROCEDURE, tmp_path, FEW, cell=cell)
    assert ended.outcome.state is State.FAILED
    assert "correct the same errors twice" in str(ended.outcome.error)


@pytest.mark.long
def test_a_run_that_lost_the_beam_is_resumed_where_it_was_with_the_instrument_prepared_again(tmp_path: Path) -> None:
    ended = run_fake(PROCEDURE, tmp_path, FEW, faults=Faults(lost=set(range(45, 999))))
    measured = len(ended.journal.recorded(PoseRow))
    again = run_fake(PROCEDURE, tmp_path, FEW, resumed=ended)
    assert again.outcome.state is State.FINISHED, again.outcome.error
    assert again.tracker.initialised == 1
    assert verdict_of(again).better
    rows = again.journal.recorded(PoseRow)
    assert 0 < measured < len(rows) == 44
    assert len({row.number for row in rows}) == 44
