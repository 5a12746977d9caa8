"""The tracker campaign over the wires: GeoCOM, Modbus, EthernetKRL, CANopen, all in lockstep."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from cellctl.engine import State
from procedures.steps.tracker.rows import FramesRow, MonumentsRow, PoseRow
from tests.helpers.runs import ROOT, Ended
from tests.helpers.tracker import CELL, Truth, found_frames, frame_errors, run, true_frames, verdict_of

pytestmark = [pytest.mark.campaign, pytest.mark.long]


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


def test_errors_of_the_turned_frames_are_as_large_as_their_covariances_state(ended: Ended) -> None:
    robot = ROOT / "procedures" / "robots" / "kr5_r1400.yaml"
    true = true_frames(ended.journal, robot, Truth(CELL, 1))
    errors = frame_errors(found_frames(ended.journal, robot), true)
    chi2 = 6.0 * sum(nees for _, _, nees in errors.values())
    assert stats.chi2.ppf(0.0005, 12) < chi2 < stats.chi2.ppf(0.9995, 12)
