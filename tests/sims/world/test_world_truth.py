"""The simulated robot against closed forms: a link table computed here, and what its errors are said to be."""

from __future__ import annotations

from dataclasses import replace
from math import acos, cos, degrees, dist, radians, sin, sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sims.cell import ERRORS
from tests.helpers.sims import BENT, CELL, world

READINGS = st.tuples(*[st.floats(joint.min, joint.max) for joint in CELL.robot.joints])


def link_table(readings):
    """Flange of the nominal robot, 4×4, by the classic Denavit-Hartenberg matrix (every beta of this robot is 0)."""
    T = np.eye(4)
    for link, joint, reading in zip(CELL.robot.links, CELL.robot.joints, readings, strict=True):
        th, al = radians(link.theta + joint.sign * reading + joint.offset), radians(link.alpha)
        T = T @ np.array(
            [
                [cos(th), -sin(th) * cos(al), sin(th) * sin(al), link.a * cos(th)],
                [sin(th), cos(th) * cos(al), -cos(th) * sin(al), link.a * sin(th)],
                [0, sin(al), cos(al), link.d],
                [0, 0, 0, 1],
            ]
        )
    return T


def taught_tool():
    a, b, c = (radians(angle) for angle in CELL.robot.tool.abc)
    T = np.eye(4)
    T[:3, :3] = [
        [cos(a) * cos(b), cos(a) * sin(b) * sin(c) - sin(a) * cos(c), cos(a) * sin(b) * cos(c) + sin(a) * sin(c)],
        [sin(a) * cos(b), sin(a) * sin(b) * sin(c) + cos(a) * cos(c), sin(a) * sin(b) * cos(c) - cos(a) * sin(c)],
        [-sin(b), cos(b) * sin(c), cos(b) * cos(c)],
    ]
    T[:3, 3] = CELL.robot.tool.xyz
    return T


@given(READINGS)
def test_without_errors_the_tool_is_where_the_link_table_puts_it(readings):
    expected = (link_table(readings) @ taught_tool())[:3, 3]
    assert np.allclose(world().true_tcp(readings), expected, atol=1e-9)


@given(READINGS)
def test_the_shown_pose_is_that_of_the_nominal_robot_whatever_is_wrong_with_the_real_one(readings):
    x, y, z, a, b, c = world(geometry=1, tool=1, joint_zero=1, deflection=1).shown_pose(readings)
    expected = link_table(readings) @ taught_tool()
    assert np.allclose([x, y, z], expected[:3, 3], atol=1e-9)
    A, B, C = radians(a), radians(b), radians(c)
    x_axis = [cos(A) * cos(B), sin(A) * cos(B), -sin(B)]
    z_axis = [cos(A) * sin(B) * cos(C) + sin(A) * sin(C), sin(A) * sin(B) * cos(C) - cos(A) * sin(C), cos(B) * cos(C)]
    assert np.allclose(x_axis, expected[:3, 0], atol=1e-7)
    assert np.allclose(z_axis, expected[:3, 2], atol=1e-7)


def test_the_stretched_arm_has_its_flange_where_the_robot_file_says():
    tool = replace(CELL.robot.tool, xyz=(0.0, 0.0, 0.0))
    bare = replace(CELL, robot=replace(CELL.robot, tool=tool))
    assert world(cell=bare).true_tcp((0.0,) * 6) == pytest.approx((1480.0, 0.0, 440.0), abs=1e-9)


@given(READINGS, st.integers(1, 50))
@settings(max_examples=30)
def test_the_tool_centre_point_is_taught_exactly_a_millimetre_and_a_half_wrong(readings, seed):
    assert dist(world(seed, tool=1).true_tcp(readings), world().true_tcp(readings)) == pytest.approx(1.5)


@pytest.mark.long
@pytest.mark.parametrize("down", [(0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (0.48, -0.6, 0.64)])
@given(readings=READINGS)
def test_the_tool_sinks_by_the_part_of_its_weight_across_it(down, readings):
    hung = replace(CELL, robot=replace(CELL.robot, down=down))
    rigid, soft = np.array(world().true_tcp(readings)), np.array(world(cell=hung, deflection=1).true_tcp(readings))
    z6 = link_table(readings)[:3, 2]
    down = np.array(down)
    most = 0.00036 * 0.4103**3 / 3 * 1.535 * 9.80665 * 1e3
    assert most == pytest.approx(0.125, abs=5e-4)
    assert np.allclose(soft - rigid, most * (down - (down @ z6) * z6), atol=1e-9)


def test_geometry_errors_have_the_size_of_the_published_table():
    offsets, tilts = [], []
    nominal = world()._shown.arm.axes
    for seed in range(150):
        for true, axis in zip(world(seed, geometry=1)._chain.arm.axes, nominal, strict=True):
            across = np.subtract(true.point, axis.point)
            assert abs(across @ axis.direction) < 1e-9
            offsets.append(across @ across / 2)
            tilts.append(degrees(acos(min(1.0, np.dot(true.direction, axis.direction)))) ** 2 / 2)
    assert sqrt(np.mean(offsets)) == pytest.approx(0.6, rel=0.06)
    assert sqrt(np.mean(tilts)) == pytest.approx(0.035, rel=0.06)


def test_an_error_scaled_by_two_is_twice_as_large():
    base, one, two = (np.array(world(tool=scale).true_tcp(BENT)) for scale in (0, 1, 2))
    assert np.allclose(two - base, 2 * (one - base))


def test_switching_one_error_off_leaves_the_others_as_they_were():
    shift = np.subtract(world(tool=1).true_tcp(BENT), world().true_tcp(BENT))
    among_others = np.subtract(
        world(tool=1, placement=1, repeatability=1).true_tcp(BENT), world(placement=1, repeatability=1).true_tcp(BENT)
    )
    assert np.allclose(shift, among_others)


def test_one_seed_is_one_robot_and_another_seed_another():
    on = dict.fromkeys(ERRORS, 1)
    assert world(3, **on).true_tcp(BENT) == world(3, **on).true_tcp(BENT)
    assert dist(world(3, **on).true_tcp(BENT), world(4, **on).true_tcp(BENT)) > 0.1


def test_the_scatter_of_a_pose_is_the_same_at_each_time_and_another_at_each_attempt():
    robot = world(repeatability=1)
    assert robot.scatter(BENT, 0) == world(repeatability=1).scatter([angle + 3e-5 for angle in BENT], 0)
    assert robot.scatter(BENT, 0) != robot.scatter(BENT, 1)
    assert robot.scatter(BENT, 0) != world(2, repeatability=1).scatter(BENT, 0)
    assert robot.tcp(BENT, (1.0, 2.0, 3.0)) == pytest.approx(np.add(robot.true_tcp(BENT), (1, 2, 3)))


def test_the_scatter_has_the_robot_files_repeatability_in_three_dimensions():
    robot = world(repeatability=1)
    squares = [np.square(robot.scatter(BENT, attempt)) for attempt in range(4000)]
    assert sqrt(np.mean(np.sum(squares, axis=1))) == pytest.approx(CELL.robot.repeatability, rel=0.03)
    assert np.allclose(np.sqrt(np.mean(squares, axis=0)), CELL.robot.repeatability / sqrt(3), rtol=0.06)


def test_encoders_show_steps_of_half_a_thousandth_degree():
    assert world(encoder=1).encoder([10.000249, -80.00026]) == pytest.approx([10.0, -80.0005], abs=1e-12)
    assert world().encoder([10.000249]) == [10.000249]
