"""The controller's model: its rows are the axes that it knows, its Jacobian the derivative, its inverse the inverse."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sims.robot_file import Joint
from sims.ur import _poses
from sims.ur._kinematics import Model, NotThisArm, calibrated_rows, nominal_rows, rows_of
from sims.world.errors import true_geometry
from sims.world.kinematics import nominal_geometry
from tests.sims.ur.conftest import CELL

ROBOT = CELL.robot
NOMINAL = nominal_rows(ROBOT)
ANGLES = st.tuples(*[st.floats(-3.0, 3.0)] * 6)
TOOL = _poses.matrix_of((0.01, -0.02, 0.15, 0.1, 0.2, 0.3))
ERRORS = {"geometry": 1.0, "joint_zero": 1.0}


def test_the_nominal_flange_is_that_of_the_world():
    flange = Model(NOMINAL).flange((0.0,) * 6)
    wanted = nominal_geometry(ROBOT).flange
    assert flange[:3, :3] == pytest.approx(wanted[:3, :3], abs=1e-12)
    assert flange[:3, 3] * 1e3 == pytest.approx(wanted[:3, 3], abs=1e-9)


@pytest.mark.parametrize("seed", range(1, 6))
def test_the_rows_of_true_axes_are_these_axes_in_another_base(seed):
    geometry = true_geometry(nominal_geometry(ROBOT), seed, 1.0)
    frames = Model(rows_of(geometry, NOMINAL)).frames((0.0,) * 6)[:-1]
    places = np.array([frame[3] for frame in frames]) * 1e3
    directions = np.array([frame[2] for frame in frames])
    true_places = np.array([axis.point for axis in geometry.axes])
    true_directions = np.array([axis.direction for axis in geometry.axes])
    # what no base changes: the angle between two axes, and how far they pass each other
    for i in range(6):
        for j in range(i):
            assert directions[i] @ directions[j] == pytest.approx(true_directions[i] @ true_directions[j], abs=1e-9)
            ours, truth = np.cross(directions[i], directions[j]), np.cross(true_directions[i], true_directions[j])
            apart = (places[i] - places[j]) @ ours
            assert apart == pytest.approx((true_places[i] - true_places[j]) @ truth, abs=1e-6)


def test_without_errors_the_rows_are_the_data_sheet():
    rows = rows_of(nominal_geometry(ROBOT), NOMINAL)
    for row, wanted in zip(rows, NOMINAL, strict=True):
        assert (row.a, row.d, row.alpha) == pytest.approx((wanted.a, wanted.d, wanted.alpha), abs=1e-9)
    assert calibrated_rows(ROBOT, 1, ERRORS, 0.0) == NOMINAL


@settings(max_examples=30, deadline=None)
@given(ANGLES)
def test_the_jacobian_is_the_derivative(joints):
    model = Model(calibrated_rows(ROBOT, 1, ERRORS, 1.0))
    jacobian, start = model.jacobian(joints, TOOL), model.flange(joints) @ TOOL
    for i in range(6):
        moved = tuple(q + (1e-6 if k == i else 0.0) for k, q in enumerate(joints))
        there = model.flange(moved) @ TOOL
        turn = Rotation.from_matrix(there[:3, :3] @ start[:3, :3].T).as_rotvec()
        change = np.concatenate([there[:3, 3] - start[:3, 3], turn]) / 1e-6
        assert change == pytest.approx(jacobian[:, i], abs=2e-3)


@settings(max_examples=30, deadline=None)
@given(ANGLES, st.integers(0, 2**31))
def test_the_inverse_of_a_pose_nearby_gives_that_pose(joints, seed):
    model = Model(calibrated_rows(ROBOT, 1, ERRORS, 1.0))
    if abs(np.linalg.det(model.jacobian(joints, TOOL))) < 0.02:
        return  # near a singularity there may be no way from one to the other
    near = tuple(q + d for q, d in zip(joints, np.random.default_rng(seed).normal(0, 0.02, 6), strict=True))
    pose = model.tcp(joints, TOOL)
    found = model.joints_at(pose, near, TOOL)
    assert found is not None
    assert np.allclose(_poses.matrix_of(model.tcp(found, TOOL)), _poses.matrix_of(pose), atol=1e-8)


def test_a_pose_out_of_reach_has_no_inverse():
    assert Model(NOMINAL).joints_at((3.0, 0, 0, 0, 0, 0), (0.0, -1.0, 1.0, 0.0, 1.0, 0.0), np.eye(4)) is None


@settings(max_examples=100, deadline=None)
@given(st.lists(st.floats(-3.14, 3.14), min_size=3, max_size=3))
def test_rotation_vectors_are_those_of_scipy(vector):
    matrix = Rotation.from_rotvec(vector).as_matrix()
    assert _poses.rotation_of(vector) == pytest.approx(matrix, abs=1e-12)
    assert Rotation.from_rotvec(_poses.vector_of(matrix)).as_matrix() == pytest.approx(matrix, abs=1e-7)


@pytest.mark.parametrize("axis", np.eye(3))
def test_half_a_turn_has_a_rotation_vector(axis):
    matrix = Rotation.from_rotvec(np.pi * axis).as_matrix()
    assert np.linalg.norm(_poses.vector_of(matrix)) == pytest.approx(np.pi)
    assert _poses.rotation_of(_poses.vector_of(matrix)) == pytest.approx(matrix, abs=1e-9)


def test_a_robot_that_is_no_ur_is_refused():
    joint = ROBOT.joints[0]
    turned = replace(ROBOT, joints=(Joint(-1, 0.0, joint.min, joint.max, joint.max_speed), *ROBOT.joints[1:]))
    with pytest.raises(NotThisArm, match="count against their axes"):
        nominal_rows(turned)
    with pytest.raises(NotThisArm, match="six joints after Denavit-Hartenberg"):
        nominal_rows(replace(ROBOT, convention="dh-craig"))
