"""Forward kinematics and Jacobians against 4×4 products and central differences written here."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellctl.kinematics import JointMap, Link, SerialChain, pose_from_xyz_abc
from tests.helpers.arms import KR5_LINKS

TOOL = pose_from_xyz_abc([59.9, 50.5, 410.3], [38.8, 3.6, 0.0])
BASE = pose_from_xyz_abc([1200.0, -300.0, 50.0], [130.0, 4.0, -7.0])


def rot(axis, angle):
    c, s = np.cos(angle), np.sin(angle)
    turn = np.eye(4)
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    turn[i, i] = turn[j, j] = c
    turn[i, j], turn[j, i] = -s, s
    return turn


def slide(axis, length):
    move = np.eye(4)
    move["xyz".index(axis), 3] = length
    return move


def product_of_matrices(convention, links, q, base, tool):
    t = base
    for link, angle in zip(links, q, strict=True):
        theta, beta = angle + link.theta, link.beta or 0.0
        if convention == "mdh-hayati":
            t = t @ rot("z", theta) @ slide("z", link.d) @ slide("x", link.a) @ rot("x", link.alpha) @ rot("y", beta)
        else:
            t = t @ rot("x", link.alpha) @ slide("x", link.a) @ rot("y", beta) @ rot("z", theta) @ slide("z", link.d)
    return t, t @ tool


def random_chain(seed, n, convention):
    rng = np.random.default_rng(seed)
    links = [
        Link(
            rng.uniform(-3, 3),
            rng.uniform(-500, 500),
            rng.uniform(-500, 500),
            rng.uniform(-2, 2),
            rng.uniform(-0.1, 0.1) if rng.random() < 0.3 else None,
        )
        for _ in range(n)
    ]
    base = pose_from_xyz_abc(rng.uniform(-900, 900, 3), rng.uniform(-180, 180, 3))
    tool = pose_from_xyz_abc(rng.uniform(-300, 300, 3), rng.uniform(-180, 180, 3))
    return SerialChain.from_links(convention, links, base, tool), links, base, tool, rng


chains = given(st.integers(0, 10_000), st.integers(1, 8), st.sampled_from(["mdh-hayati", "dh-craig"]))


@settings(max_examples=40)
@chains
def test_forward_equals_the_product_of_the_conventions_matrices(seed, n, convention):
    chain, links, base, tool, rng = random_chain(seed, n, convention)
    q = rng.uniform(-3, 3, (3, n))
    for angles, tcp, flange in zip(q, chain.forward(q), chain.forward_flange(q), strict=True):
        expected_flange, expected_tcp = product_of_matrices(convention, links, angles, base, tool)
        np.testing.assert_allclose(tcp, expected_tcp, atol=1e-9)
        np.testing.assert_allclose(flange, expected_flange, atol=1e-9)


@settings(max_examples=20)
@chains
def test_the_frame_behind_each_joint_holds_its_axis_and_the_last_is_the_flange(seed, n, convention):
    chain, *_, rng = random_chain(seed, n, convention)
    q = rng.uniform(-3, 3, (2, 3, n))
    frames = chain.frames(q)
    assert frames.shape == (2, 3, n + 1, 4, 4)
    np.testing.assert_allclose(frames[..., -1, :, :], chain.forward_flange(q), atol=1e-9)
    tip = chain.forward(q)[..., :3, 3]
    joints = chain.tool_jacobian(q)
    for index in range(n):
        axis, point = frames[..., index, :3, 2], frames[..., index, :3, 3]
        np.testing.assert_allclose(joints[..., 3:, index], axis, atol=1e-9)
        np.testing.assert_allclose(joints[..., :3, index], np.cross(axis, tip - point), atol=1e-9)
        turned = chain.frames(q + 0.3 * np.eye(n)[index])[..., index, :, :]
        np.testing.assert_allclose(turned, frames[..., index, :, :] @ rot("z", 0.3), atol=1e-9)


def central_difference(pose_of, step):
    ahead, behind, here = pose_of(step), pose_of(-step), pose_of(0.0)
    rate = (ahead - behind) / (2 * step)
    spin = rate[:3, :3] @ here[:3, :3].T
    return np.array([*rate[:3, 3], spin[2, 1], spin[0, 2], spin[1, 0]])


@settings(max_examples=25)
@chains
def test_tool_jacobian_equals_central_differences(seed, n, convention):
    chain, *_, rng = random_chain(seed, n, convention)
    q = rng.uniform(-3, 3, n)
    numeric = [central_difference(lambda h, e=e: chain.forward(q + h * e), 1e-5) for e in np.eye(n)]
    np.testing.assert_allclose(chain.tool_jacobian(q), np.array(numeric).T, atol=2e-5)


@settings(max_examples=25)
@chains
def test_every_parameter_column_equals_central_differences_away_from_the_table(seed, n, convention):
    chain, *_, rng = random_chain(seed, n, convention)
    scale = np.where(chain.parameter_turns, 0.02, 5.0)
    here = scale * rng.standard_normal(scale.size)
    q = rng.uniform(-3, 3, n)
    columns = chain.with_parameters(here).parameter_jacobian(q)
    for index, name in enumerate(chain.parameters):
        unit = np.eye(scale.size)[index]
        step = 1e-5 if chain.parameter_turns[index] else 1e-2
        numeric = central_difference(lambda h, u=unit: chain.with_parameters(here + h * u).forward(q), step)
        np.testing.assert_allclose(columns[:, index], numeric, atol=2e-5, err_msg=name)


def test_the_stretched_kr5_flange_is_where_its_data_sheet_puts_it():
    flange = SerialChain.from_links("mdh-hayati", KR5_LINKS).forward_flange(np.zeros(6))
    np.testing.assert_allclose(flange[:3, 3], [1480, 0, 440], atol=1e-9)


def test_batches_keep_their_leading_axes_and_agree_with_single_poses():
    chain = SerialChain.from_links("mdh-hayati", KR5_LINKS, BASE, TOOL)
    q = np.random.default_rng(1).uniform(-2, 2, (3, 700, 6))
    poses, joints = chain.forward_and_jacobian(q)
    assert poses.shape == (3, 700, 4, 4)
    assert joints.shape == (3, 700, 6, 6)
    assert chain.parameter_jacobian(q).shape == (3, 700, 6, len(chain.parameters))
    np.testing.assert_allclose(poses[2, 699], chain.forward(q[2, 699]), atol=1e-9)
    np.testing.assert_allclose(poses, chain.forward(q), atol=0)
    np.testing.assert_allclose(joints[1, 5], chain.tool_jacobian(q[1, 5]), atol=1e-9)
    np.testing.assert_allclose(joints, chain.tool_jacobian(q), atol=0)


def test_a_parallel_axis_has_beta_and_no_d():
    names = SerialChain.from_links("mdh-hayati", KR5_LINKS).parameters
    assert "beta2" in names
    assert "d2" not in names
    assert len(names) == 24 + 12


def test_deviations_may_be_given_by_name_and_unknown_names_are_refused():
    chain = SerialChain.from_links("mdh-hayati", KR5_LINKS, BASE, TOOL)
    longer = chain.with_parameters({"a2": 1.0, "tool_z": 2.0})
    assert longer.deviations[chain.parameters.index("a2")] == 1.0
    assert longer.tool_now[2, 3] == pytest.approx(TOOL[2, 3] + 2.0 * TOOL[2, 2])
    with pytest.raises(ValueError, match="a22"):
        chain.with_parameters({"a22": 1.0})
    with pytest.raises(ValueError, match="deviations"):
        chain.with_parameters(np.zeros(3))


def test_a_new_base_replaces_the_bases_deviations_and_keeps_the_others():
    chain = SerialChain.from_links("mdh-hayati", KR5_LINKS, BASE, TOOL).with_parameters({"base_x": 5.0, "a2": 1.0})
    moved = chain.with_base(np.eye(4))
    assert dict(zip(moved.parameters, moved.deviations, strict=True))["a2"] == 1.0
    np.testing.assert_allclose(moved.base_now, np.eye(4))


@pytest.mark.parametrize("bad", [np.eye(3), np.diag([1.0, 1.0, -1.0, 1.0]), 2 * np.eye(4), np.diag([2.0, 1, 1, 1])])
def test_a_base_that_is_no_rigid_motion_is_refused(bad):
    with pytest.raises(ValueError, match="base"):
        SerialChain.from_links("mdh-hayati", KR5_LINKS, bad)


def test_an_unknown_convention_and_an_empty_table_are_refused():
    with pytest.raises(ValueError, match="poe"):
        SerialChain.from_links("poe", KR5_LINKS)
    with pytest.raises(ValueError, match="link"):
        SerialChain.from_links("mdh-hayati", [])


def test_wrong_number_of_joint_angles_is_refused():
    with pytest.raises(ValueError, match="6 joints"):
        SerialChain.from_links("mdh-hayati", KR5_LINKS).forward(np.zeros(5))


@given(st.lists(st.floats(-350, 350), min_size=6, max_size=6))
def test_joint_map_and_back_returns_the_controllers_readings(readings):
    joints = JointMap.from_lists([-1, 1, 1, -1, 1, -1], [0, 90, -15, 0.5, 0, 180])
    np.testing.assert_allclose(joints.readings(joints.model(readings)), readings, atol=1e-10)


def test_joint_map_applies_sign_then_offset():
    joints = JointMap.from_lists([-1, 1], [10, 0])
    np.testing.assert_allclose(joints.model([30.0, 45.0]), np.deg2rad([-20.0, 45.0]))
    with pytest.raises(ValueError, match="sign"):
        JointMap.from_lists([2, 1], [0, 0])
    with pytest.raises(ValueError, match="2 signs"):
        JointMap.from_lists([1, 1], [0])
