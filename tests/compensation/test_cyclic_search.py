"""Cyclic search: joints at which the predicted TCP is at the target."""

from __future__ import annotations

import numpy as np
from kr5_model import ROBOT

from cellctl.compensation import cyclic_search
from cellctl.formats import RobotFile

CHAIN = RobotFile.load(ROBOT).chain()
ACTUAL = CHAIN.with_parameters({"theta2": 0.003, "a2": -0.7, "d4": 0.8, "alpha4": 0.0009})
START = np.radians([[0.0, -60.0, 80.0, 10.0, 60.0, 20.0], [20.0, -70.0, 90.0, -15.0, 50.0, 5.0]])
TARGETS = CHAIN.forward(START)


def errors(q: np.ndarray) -> np.ndarray:
    return np.asarray(ACTUAL.forward(q)[:, :3, 3] - CHAIN.forward(q)[:, :3, 3])


def test_the_actual_tcp_is_at_the_target_with_the_nominal_orientation_held() -> None:
    before = np.linalg.norm(errors(START), axis=1)
    found = cyclic_search(CHAIN, errors, TARGETS, START)
    after = np.linalg.norm(ACTUAL.forward(found.q)[:, :3, 3] - TARGETS[:, :3, 3], axis=1)
    assert before.min() > 1.0
    assert found.converged.all()
    assert after.max() < 0.001
    assert np.abs(CHAIN.forward(found.q)[:, :3, :3] - TARGETS[:, :3, :3]).max() < 1e-9


def test_a_target_beyond_the_reach_is_not_converged_and_leaves_the_others_alone() -> None:
    targets = TARGETS.copy()
    targets[0, :3, 3] *= 3.0
    found = cyclic_search(CHAIN, errors, targets, START)
    assert found.converged.tolist() == [False, True]
    assert found.predicted_mm[1] < 0.001


def test_errors_of_zero_need_no_round() -> None:
    found = cyclic_search(CHAIN, lambda q: np.zeros((len(q), 3)), TARGETS, START)
    assert found.rounds == 0
