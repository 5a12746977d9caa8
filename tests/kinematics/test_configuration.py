"""Status and turn of postures, against the numbers that KUKA controllers show."""

from pathlib import Path

import numpy as np
import pytest

from cellctl.formats import RobotFile
from cellctl.kinematics import pose_from_xyz_abc
from cellctl.kinematics.controller_readings import status_of, turn_of

ROBOTS = Path(__file__).parents[2] / "procedures" / "robots"


@pytest.fixture(scope="module")
def robot():
    return RobotFile.load(ROBOTS / "kr6_r900_sixx.yaml")


@pytest.mark.parametrize(
    ("readings", "turn"),
    [
        ([0, -90, 90, 0, 0, 0], 2),
        ([-10, -90, 90, 0, 45, -20], 35),
        ([10, -90, 90, 0, -45, -20], 50),
        ([-10, -90, 90, -5, -45, 20], 27),
        ([-1, -1, -1, -1, -1, -1], 63),
        ([0, 0, 0, 0, 0, 0], 0),
    ],
)
def test_turn_has_a_bit_for_each_axis_below_zero(readings, turn):
    assert turn_of(readings) == turn


@pytest.mark.parametrize(
    ("readings", "status"),
    [
        ([0, -90, 90, 0, 30, 0], 2),  # the usual posture: arm up, forearm forward
        ([-130, -90, 90, 0, 30, 0], 2),  # turned by A1 only
        ([0, -90, 90, 0, -30, 0], 6),
        ([0, -90, -60, 0, 30, 0], 1),  # elbow the other way: the wrist is behind axis 1
        ([0, -45, -30, 0, -30, 0], 4),
        ([0, -150, 30, 0, 30, 0], 3),  # leaning back beyond axis 1
        ([150, -150, 30, 170, 30, 0], 3),
    ],
)
def test_status_says_overhead_elbow_and_sign_of_a5(robot, readings, status):
    assert status_of(robot.chain(), robot.joint_map(), readings) == status


def test_the_elbow_changes_where_the_wrist_crosses_the_line_through_axes_2_and_3(robot):
    # 35 mm between axes 3 and 4, 420 mm from there to the wrist centre
    angle = np.degrees(np.arctan2(35.0, 420.0))
    readings = np.array([[20, -40, bend, 10, 30, 0] for bend in (angle - 0.01, angle + 0.01, -angle)])
    found = status_of(robot.chain(), robot.joint_map(), readings) & 2
    assert found.tolist() == [0, 2, 0]


def test_a_base_that_was_moved_changes_no_status(robot):
    moved = robot.chain().with_base(pose_from_xyz_abc([5000.0, -3000.0, 100.0], [170.0, 20.0, -30.0]))
    rng = np.random.default_rng(4)
    readings = rng.uniform(-1.0, 1.0, (50, 6)) * [160, 90, 110, 170, 100, 300] - [0, 60, 0, 0, 0, 0]
    here = status_of(robot.chain(), robot.joint_map(), readings)
    np.testing.assert_array_equal(status_of(moved, robot.joint_map(), readings), here)
    assert len(set(here.tolist())) > 4


def test_seven_joints_have_no_status():
    robot = RobotFile.load(ROBOTS / "iiwa14.yaml")
    with pytest.raises(ValueError, match="has 7"):
        status_of(robot.chain(), robot.joint_map(), np.zeros(7))
