"""Robots given by their joints' axes, against matrix exponentials of twists and central differences written here."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from cellctl.kinematics import JointAxis, SerialChain, inverse, pose_from_xyz_abc, to_poe


def twist(direction, point):
    """4×4 of the unit twist ξ = (ω, v = r × ω)."""
    x, y, z = direction
    result = np.zeros((4, 4))
    result[:3, :3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
    result[:3, 3] = np.cross(point, direction)
    return result


def random_robot(seed, n):
    rng = np.random.default_rng(seed)
    directions = rng.standard_normal((n, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    parallel = rng.random(n) < 0.3
    parallel[0] = False
    for index in np.flatnonzero(parallel):
        directions[index] = directions[index - 1]
    points = rng.uniform(-900, 900, (n, 3))
    home, base, tool = (pose_from_xyz_abc(rng.uniform(-500, 500, 3), rng.uniform(-180, 180, 3)) for _ in range(3))
    axes = [JointAxis.through(point, 3.0 * direction) for point, direction in zip(points, directions, strict=True)]
    return SerialChain.from_axes(axes, home, base, tool), directions, points, home, base, tool, rng


def joint_frame(direction, point):
    """x is X of the base made square to the axis, or Y where X lies within 49° of it (cosine 0.65), or Z."""
    across = next(unit for unit in np.eye(3) if abs(unit @ direction) < 0.65)
    x = across - (across @ direction) * direction
    x /= np.linalg.norm(x)
    frame = np.eye(4)
    frame[:3] = np.column_stack([x, np.cross(direction, x), direction, point])
    return frame


def moved(turn_x, turn_y, slide_x, slide_y, theta):
    """About x, then about the new y, along the new x and y, about the axis itself."""
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_euler("XYZ", [turn_x, turn_y, 0.0]).as_matrix()
    slide, about = np.eye(4), np.eye(4)
    slide[:2, 3] = slide_x, slide_y
    about[:3, :3] = Rotation.from_rotvec([0, 0, theta]).as_matrix()
    return turn @ slide @ about


robots = given(st.integers(0, 10_000), st.sampled_from([1, 2, 6, 7, 9]))


@settings(max_examples=30)
@robots
def test_forward_is_the_product_of_exponentials(seed, n):
    chain, directions, points, home, base, tool, rng = random_robot(seed, n)
    q = rng.uniform(-3, 3, n)
    expected = base.copy()
    for direction, point, angle in zip(directions, points, q, strict=True):
        expected = expected @ expm(twist(direction, point) * angle)
    np.testing.assert_allclose(chain.forward_flange(q), expected @ home, atol=1e-9)
    np.testing.assert_allclose(chain.forward(q), expected @ home @ tool, atol=1e-9)


@settings(max_examples=30)
@robots
def test_a_joints_motions_move_its_axis_in_its_own_frame_and_carry_what_is_behind(seed, n):
    chain, directions, points, home, base, tool, rng = random_robot(seed, n)
    small = rng.standard_normal((n, 5)) * [0.02, 0.02, 4.0, 4.0, 0.02]
    kinds = ["turn_x", "turn_y", "slide_x", "slide_y", "theta"]
    named = {f"{kind}{i + 1}": small[i, k] for i in range(n) for k, kind in enumerate(kinds)}
    q = rng.uniform(-3, 3, n)
    expected = base.copy()
    for direction, point, angle, amounts in zip(directions, points, q, small, strict=True):
        own = joint_frame(direction, point)
        expected = expected @ own @ moved(*amounts) @ np.linalg.inv(own) @ expm(twist(direction, point) * angle)
    np.testing.assert_allclose(chain.with_parameters(named).forward(q), expected @ home @ tool, atol=1e-8)


@pytest.mark.long
@settings(max_examples=20)
@robots
def test_every_column_equals_central_differences_away_from_the_nominal_axes(seed, n):
    chain, *_, rng = random_robot(seed, n)
    here = np.where(chain.parameter_turns, 0.02, 5.0) * rng.standard_normal(len(chain.parameters))
    q = rng.uniform(-3, 3, n)
    identified = chain.with_parameters(here)
    columns, joints = identified.parameter_jacobian(q), identified.tool_jacobian(q)
    assert len(chain.parameters) == 5 * n + 12
    for index, name in enumerate(chain.parameters):
        step = (1e-5 if chain.parameter_turns[index] else 1e-2) * np.eye(here.size)[index]
        numeric = rate([chain.with_parameters(here + sign * step).forward(q) for sign in (1, -1)], identified, q)
        np.testing.assert_allclose(columns[:, index], numeric / (2 * step.max()), atol=2e-5, err_msg=name)
    for index in range(n):
        step = 1e-5 * np.eye(n)[index]
        numeric = rate([identified.forward(q + step), identified.forward(q - step)], identified, q)
        np.testing.assert_allclose(joints[:, index], numeric / 2e-5, atol=2e-5)


def rate(ahead_and_behind, chain, q):
    difference = ahead_and_behind[0] - ahead_and_behind[1]
    spin = difference[:3, :3] @ chain.forward(q)[:3, :3].T
    return np.array([*difference[:3, 3], spin[2, 1], spin[0, 2], spin[1, 0]])


@pytest.mark.parametrize("n", [1, 2, 3, 6, 7, 9])
def test_four_motions_a_joint_and_the_tool_are_all_that_poses_can_tell_and_joint_zeros_add_nothing(n):
    chain, *_, rng = random_robot(n, n)
    poses = chain.parameter_jacobian(rng.uniform(-3, 3, (60, n)))
    stacked = (poses / np.where(chain.parameter_turns, 1.0, 500.0)).reshape(-1, len(chain.parameters))
    stacked[np.arange(len(stacked)) % 6 < 3] /= 500.0
    names = np.array(chain.parameters)
    zeros = np.char.startswith(names, "theta")
    base = np.char.startswith(names, "base")
    assert np.linalg.matrix_rank(stacked, tol=1e-9) == 4 * n + 6
    assert np.linalg.matrix_rank(stacked[:, ~zeros & ~base], tol=1e-9) == 4 * n + 6 == np.count_nonzero(~zeros & ~base)


@pytest.mark.parametrize("length", [1e-320, 1e-200, 1e300])
def test_an_axis_may_be_given_with_any_length(length):
    axis = JointAxis.through([0, 0, 0], [0, length, length])
    np.testing.assert_allclose(axis.direction, [0, np.sqrt(0.5), np.sqrt(0.5)], atol=1e-12)


def test_a_zero_axis_and_an_axis_that_is_no_vector_are_refused():
    with pytest.raises(ValueError, match="no direction"):
        JointAxis.through([0, 0, 0], [0, 0, 0])
    for bad in ([0, 0], [0, 0, np.nan]):
        with pytest.raises(ValueError, match="three numbers"):
            JointAxis.through([0, 0, 0], bad)
    with pytest.raises(ValueError, match="at least one joint"):
        SerialChain.from_axes([], np.eye(4))
    with pytest.raises(ValueError, match="home"):
        SerialChain.from_axes([JointAxis.through([0, 0, 0], [0, 0, 1])], np.diag([1.0, 1, -1, 1]))


def test_inverse_kinematics_close_to_a_millionth_of_a_micrometre_for_seven_axes():
    chain, *_, rng = random_robot(3, 7)
    q = rng.uniform(-1.5, 1.5, (50, 7))
    result = inverse(chain, chain.forward(q), q + rng.uniform(-0.03, 0.03, q.shape))
    assert result.converged.all()
    assert result.error_mm.max() < 1e-9


def test_the_axes_of_an_identified_robot_are_where_its_deviations_put_them():
    chain, *_, rng = random_robot(11, 6)
    small = np.where(chain.parameter_turns, 0.01, 2.0) * rng.standard_normal(len(chain.parameters))
    settled = to_poe(chain.with_parameters(small))
    assert not settled.deviations.any()
    q = rng.uniform(-3, 3, (20, 6))
    np.testing.assert_allclose(settled.forward(q), chain.with_parameters(small).forward(q), atol=1e-9)
