"""Frames against SciPy's rotations, and against matrices written out by hand."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cellctl.kinematics import (
    abc_from_rotation,
    inverse_pose,
    pose_from_xyz_abc,
    rotation_from_abc,
    rotation_from_quaternion,
    rotation_vector,
)

degrees = st.floats(-180, 180)


def test_abc_is_a_about_z_then_b_about_y_then_c_about_x():
    a, b, c = np.deg2rad([30, -40, 50])
    rz = [[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]]
    ry = [[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]]
    rx = [[1, 0, 0], [0, np.cos(c), -np.sin(c)], [0, np.sin(c), np.cos(c)]]
    np.testing.assert_allclose(rotation_from_abc([30, -40, 50]), np.array(rz) @ ry @ rx, atol=1e-12)


@given(degrees, st.floats(-90, 90), degrees)
def test_angles_of_a_matrix_give_that_matrix_again_at_the_singularity_too(a, b, c):
    for angles in ([a, b, c], [a, 90, c], [a, -90, c]):
        turn = rotation_from_abc(angles)
        np.testing.assert_allclose(rotation_from_abc(abc_from_rotation(turn)), turn, atol=3e-14)


@given(degrees, st.floats(-12, -3), degrees, st.sampled_from([1, -1]))
def test_angles_close_to_the_singularity_give_the_matrix_again_to_rounding(a, exponent, c, side):
    turn = rotation_from_abc([a, side * (90 - 10**exponent), c])
    np.testing.assert_allclose(rotation_from_abc(abc_from_rotation(turn)), turn, rtol=0, atol=3e-14)


@given(degrees, degrees, degrees)
def test_inverse_pose_undoes_the_pose(a, b, c):
    frame = pose_from_xyz_abc([100, -20, 3], [a, b, c])
    np.testing.assert_allclose(inverse_pose(frame) @ frame, np.eye(4), atol=1e-10)


@given(st.lists(st.floats(-1.7, 1.7), min_size=3, max_size=3))
def test_rotation_vector_returns_the_vector_that_made_the_matrix(vector):
    np.testing.assert_allclose(rotation_vector(Rotation.from_rotvec(vector).as_matrix()), vector, atol=1e-7)


@given(st.lists(st.floats(-1, 1), min_size=3, max_size=3).filter(lambda axis: np.linalg.norm(axis) > 0.1))
def test_rotation_vector_of_a_half_turn_or_next_to_it_is_not_taken_for_none(axis):
    unit = np.array(axis) / np.linalg.norm(axis)
    for short_of in (0.0, 1e-13, 1e-9, 3e-7, 1e-5):
        turn = Rotation.from_rotvec((np.pi - short_of) * unit).as_matrix()
        found = rotation_vector(turn)
        assert abs(np.linalg.norm(found) - (np.pi - short_of)) < 1e-9
        np.testing.assert_allclose(Rotation.from_rotvec(found).as_matrix(), turn, atol=1e-9)


def test_half_turns_among_other_turns_are_each_their_own():
    vectors = np.array([[[0.1, 0, 0], [0, np.pi, 0]], [[0, 0, 0], [0, 0, np.pi]]])
    turns = Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix().reshape(2, 2, 3, 3)
    np.testing.assert_allclose(np.abs(rotation_vector(turns)), vectors, atol=1e-9)


def test_quaternion_has_its_real_part_first_and_may_have_any_length():
    quarter_turn = rotation_from_quaternion([[2.0, 0, 0, 2.0]])
    np.testing.assert_allclose(quarter_turn, [[[0, -1, 0], [1, 0, 0], [0, 0, 1]]], atol=1e-12)
