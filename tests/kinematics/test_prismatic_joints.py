"""Prismatic joints: forward kinematics against products written here, Jacobians against central differences."""

import numpy as np
import pytest

from cellctl.kinematics import (
    JointAxis,
    JointMap,
    Link,
    SerialChain,
    inverse,
    pose_from_xyz_abc,
    to_craig,
    to_mdh,
    to_poe,
)
from tests.helpers.arms import KR5_LINKS

BASE = pose_from_xyz_abc([1200.0, -300.0, 50.0], [130.0, 4.0, -7.0])
TOOL = pose_from_xyz_abc([59.9, 50.5, 410.3], [38.8, 3.6, 0.0])
RAIL = Link(0.3, 40.0, 25.0, np.pi / 2, prismatic=True)
QUILL = Link(0.2, -30.0, 10.0, 0.4, prismatic=True)
ARMS = {
    "rail": SerialChain.from_links("mdh-hayati", [RAIL, *KR5_LINKS], BASE, TOOL),
    "lift beside a parallel axis": SerialChain.from_links(
        "mdh-hayati", [Link(0.1, 15.0, 8.0, 0.0, 0.0, prismatic=True), *KR5_LINKS], BASE, TOOL
    ),
    "quill": SerialChain.from_links("dh-craig", [*KR5_LINKS, QUILL], BASE, TOOL),
    "axes": SerialChain.from_axes(
        [
            JointAxis.through([5.0, 6.0, 7.0], [1.0, 0.2, 0.0], prismatic=True),
            JointAxis.through([0.0, 0.0, 300.0], [0.0, 0.0, 1.0]),
            JointAxis.through([100.0, 0.0, 300.0], [0.0, 1.0, 0.3]),
            JointAxis.through([400.0, 20.0, 300.0], [0.1, 0.0, 1.0], prismatic=True),
        ],
        pose_from_xyz_abc([500.0, 0.0, 300.0], [10.0, 80.0, 0.0]),
        BASE,
        TOOL,
    ),
}


@pytest.fixture(params=list(ARMS))
def chain(request):
    return ARMS[request.param]


def postures(chain, count=8):
    return np.random.default_rng(3).uniform(-1.5, 1.5, (count, chain.n))


def deviated(chain):
    return chain.with_parameters(np.random.default_rng(4).normal(0.0, 0.01, len(chain.parameters)))


def differences(function, at, step):
    return np.stack([(function(at + d) - function(at - d)) / (2 * step) for d in step * np.eye(at.size)], axis=-1)


def twist(chain_at, at, step):
    """Velocity and angular velocity (6, P) of the TCP by the numbers `at`."""
    pose = chain_at(at)
    slopes = differences(chain_at, at, step)
    skew = np.einsum("ijp,kj->ikp", slopes[:3, :3], pose[:3, :3])
    return np.vstack([slopes[:3, 3], np.stack([skew[2, 1], skew[0, 2], skew[1, 0]])])


def test_a_prismatic_joint_moves_the_tool_along_its_axis_by_metres(chain):
    for q in postures(chain):
        frames = chain.frames(q)
        for joint in np.flatnonzero(chain.prismatic):
            further = q + 0.25 * np.eye(chain.n)[joint]
            moved = chain.forward(further) @ np.linalg.inv(chain.forward(q))
            np.testing.assert_allclose(moved[:3, :3], np.eye(3), atol=1e-12)
            np.testing.assert_allclose(moved[:3, 3], 250.0 * frames[joint, :3, 2], atol=1e-9)


@pytest.mark.parametrize("convention", ["mdh-hayati", "dh-craig"])
def test_in_a_link_table_the_joint_adds_to_d_and_not_to_theta(convention):
    rows = [RAIL, KR5_LINKS[0], QUILL]
    q = np.array([0.7, 0.5, -0.2])
    at = [
        Link(row.theta, row.d + 1000.0 * value, row.a, row.alpha) if row.prismatic
        else Link(row.theta + value, row.d, row.a, row.alpha)
        for row, value in zip(rows, q, strict=True)
    ]  # fmt: skip
    found = SerialChain.from_links(convention, rows, BASE, TOOL).forward(q)
    wanted = SerialChain.from_links(convention, at, BASE, TOOL).forward(np.zeros(3))
    np.testing.assert_allclose(found, wanted, atol=1e-9)


def test_the_joints_jacobian_is_that_of_central_differences(chain):
    robot = deviated(chain)
    for q in postures(chain, 3):
        _, found = robot.forward_and_jacobian(q)
        np.testing.assert_allclose(found, twist(robot.forward, q, 1e-6), rtol=1e-6, atol=2e-3)
        np.testing.assert_array_equal(found, robot.tool_jacobian(q))


def test_the_parameters_jacobian_is_that_of_central_differences(chain):
    robot = deviated(chain)
    q = postures(chain, 1)[0]
    wanted = twist(lambda values: robot.with_parameters(values).forward(q), robot.deviations, 1e-5)
    np.testing.assert_allclose(robot.parameter_jacobian(q), wanted, rtol=1e-6, atol=2e-3)


def test_a_prismatic_joints_zero_is_a_parameter_and_the_place_of_its_axis_is_none():
    names = ARMS["axes"].parameters
    assert {"turn_x1", "turn_y1", "d1", "slide_x2", "theta2", "d4"} <= set(names)
    assert not {"slide_x1", "slide_y1", "theta1", "slide_x4", "theta4", "d2"} & set(names)
    assert "d1" in ARMS["lift beside a parallel axis"].parameters
    assert "d1" not in SerialChain.from_links("mdh-hayati", [Link(beta=0.0), *KR5_LINKS]).parameters


@pytest.mark.parametrize("convert", [to_poe, to_mdh, to_craig])
def test_every_form_has_the_tool_at_the_same_place(chain, convert):
    robot = deviated(chain)
    same = convert(robot)
    np.testing.assert_array_equal(same.prismatic, chain.prismatic)
    np.testing.assert_allclose(same.forward(postures(chain)), robot.forward(postures(chain)), atol=1e-9)


def test_the_inverse_finds_a_pose_of_an_arm_on_a_rail():
    chain = ARMS["rail"]
    q = postures(chain, 20)
    found = inverse(chain, chain.forward(q), q + 0.05)
    assert found.converged.all()
    np.testing.assert_allclose(chain.forward(found.q), chain.forward(q), atol=1e-6)


def test_readings_of_a_prismatic_joint_are_mm_and_its_coordinate_is_m():
    joints = JointMap.from_lists([-1, 1], [200.0, 10.0], [True, False])
    assert joints.units == ("mm", "°")
    np.testing.assert_allclose(joints.model([500.0, 35.0]), [-0.3, np.deg2rad(45.0)], rtol=1e-15)
    np.testing.assert_allclose(joints.readings(joints.model([[500.0, 35.0]])), [[500.0, 35.0]], rtol=1e-15)


def test_a_map_without_prismatic_joints_keeps_every_digit():
    readings = np.random.default_rng(0).uniform(-180.0, 180.0, (50, 3))
    joints = JointMap.from_lists([1, -1, 1], [0.0, 90.0, 5.0], [False] * 3)
    assert joints.prismatic is None
    np.testing.assert_array_equal(joints.model(readings), np.deg2rad(joints.sign * readings + joints.offset))
