"""Cyclic search: joints at which the predicted TCP is at the target."""

from __future__ import annotations

import numpy as np
import pytest

from cellctl.calibration import RobotModel
from cellctl.compensation import METHODS, compensate
from cellctl.error_maps.field import AnisotropicField
from cellctl.error_maps.kriging import INITIAL_WEIGHTS, Kriging
from cellctl.error_maps.perceptron import Perceptron
from cellctl.formats import RobotFile
from cellctl.kinematics import pose_difference
from tests.helpers.arms import KR5_FILE

CHAIN = RobotFile.load(KR5_FILE).chain()
ACTUAL = CHAIN.with_parameters({"theta2": 0.003, "a2": -0.7, "d4": 0.8, "alpha4": 0.0009})
START = np.radians([[0.0, -60.0, 80.0, 10.0, 60.0, 20.0], [20.0, -70.0, 90.0, -15.0, 50.0, 5.0]])
TARGETS = CHAIN.forward(START)


def errors(q: np.ndarray) -> np.ndarray:
    return np.asarray(ACTUAL.forward(q)[:, :3, 3] - CHAIN.forward(q)[:, :3, 3])


def searched(predicted, targets):
    return compensate(CHAIN, predicted, targets, START, method="cyclic-search")


def test_the_actual_tcp_is_at_the_target_with_the_nominal_orientation_held() -> None:
    before = np.linalg.norm(errors(START), axis=1)
    found = searched(errors, TARGETS)
    after = np.linalg.norm(ACTUAL.forward(found.compensated_q)[:, :3, 3] - TARGETS[:, :3, 3], axis=1)
    assert before.min() > 1.0
    assert found.converged.all()
    assert after.max() <= 1e-6
    assert np.abs(CHAIN.forward(found.compensated_q)[:, :3, :3] - TARGETS[:, :3, :3]).max() < 1e-9


def test_a_target_beyond_the_reach_is_not_converged_and_leaves_the_others_alone() -> None:
    targets = TARGETS.copy()
    targets[0, :3, 3] *= 3.0
    found = searched(errors, targets)
    assert found.converged.tolist() == [False, True]
    assert found.predicted_after_mm[1] <= 1e-6


def test_errors_of_zero_need_no_round() -> None:
    found = searched(lambda q: np.zeros((len(q), 3)), TARGETS)
    assert found.passes == 0


def test_the_identified_model_predicts_positions_too() -> None:
    robot = RobotModel(ACTUAL)
    found = compensate(CHAIN, robot, TARGETS, START, method="cyclic-search")
    assert found.position_only
    assert found.predicted_after_mm.max() <= 1e-6
    turned = np.degrees(np.linalg.norm(pose_difference(TARGETS, robot.pose(found.compensated_q))[:, 3:], axis=1))
    np.testing.assert_allclose(found.error_deg[-1], turned)
    assert turned.min() > 0.05


def test_a_map_of_position_errors_says_nothing_about_the_orientation() -> None:
    assert np.isnan(searched(errors, TARGETS).error_deg).all()


@pytest.mark.parametrize("method", [name for name in METHODS if name != "cyclic-search"])
def test_other_methods_refuse_an_error_map(method) -> None:
    with pytest.raises(ValueError, match="needs an identified model; position errors are for cyclic-search"):
        compensate(CHAIN, errors, TARGETS, START, method=method)


@pytest.mark.parametrize("method", [Kriging(INITIAL_WEIGHTS), AnisotropicField(), Perceptron(alpha=1e-3)])
def test_measured_errors_compensate_through_a_map_by_kriging_a_field_or_a_network(method) -> None:
    """What the map cannot know remains: a tenth of the error near dense samples."""
    near = START[0] + np.random.default_rng(3).uniform(-0.15, 0.15, (150, 6))
    found_map = method.fit(near, errors(near))
    found = compensate(CHAIN, found_map.errors, TARGETS[:1], START[:1], method="cyclic-search")
    after = np.linalg.norm(ACTUAL.forward(found.compensated_q)[:, :3, 3] - TARGETS[:1, :3, 3], axis=1)
    assert found.converged.all()
    assert after[0] < 0.1 * np.linalg.norm(errors(START[:1]))
