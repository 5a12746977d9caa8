"""Almost parallel axes: URDF and DH table keep every length below the robot's reach, and the TCP exact."""

import csv
import io
import re

import numpy as np
import pytest

from cellctl.files import InputError
from cellctl.formats.description import JointSaid, RobotDescription
from cellctl.formats.dh_table import dh_table_text
from cellctl.formats.urdf import urdf_text
from cellctl.kinematics import JointAxis, SerialChain
from tests.helpers.arms import by_axes, library_robot, perturbed
from tests.helpers.own_model import assert_same_pose, forward_of_dh_table, forward_of_urdf

URS = ["ur3", "ur3e", "ur5", "ur5e", "ur10", "ur10e", "ur16e"]


@pytest.fixture(params=["by links", "by axes"])
def robot(request, name):
    found = library_robot(name)
    return by_axes(found) if request.param == "by axes" else found


@pytest.mark.parametrize("name", URS)
@pytest.mark.parametrize("tilt", [1e-6, 1e-2])
def test_no_link_is_longer_than_the_reach(name, tilt, robot):
    model = perturbed(robot, 7, tilt, 0.5)
    found = RobotDescription.of(robot, model.robot_model().chain)
    urdf, table = urdf_text(found), dh_table_text(found, "mdh-hayati")
    reach = robot.chain().reach_mm
    steps = re.findall(r'<child link="(?:link_\d|tool0)"/>\s*<origin xyz="([^"]*)"', urdf)
    assert len(steps) == 7
    assert np.abs([[1000.0 * float(word) for word in step.split()] for step in steps]).max() < reach
    rows = [row for row in csv.DictReader(io.StringIO(table)) if row["joint"] not in ("base", "tool")]
    assert np.abs([[float(row["d"]), float(row["a"])] for row in rows]).max() < reach
    for readings in np.random.default_rng(3).uniform(-180.0, 180.0, (3, 6)):
        pose = model.robot_model().pose(robot.joint_map().model(readings))
        assert_same_pose(forward_of_urdf(urdf, "tcp", np.radians(readings)), pose)
        assert_same_pose(forward_of_dh_table(table, readings), pose)


def test_axes_just_too_far_from_parallel_for_a_table_are_refused_before_it_is_written():
    skew = [JointAxis.through([0, 0, 0], [0, 0, 1]), JointAxis.through([500, 19000, 0], [0, 0.018, 1])]
    robot = RobotDescription("skew", SerialChain.from_axes(skew, np.eye(4)), (JointSaid(), JointSaid()))
    with pytest.raises(InputError, match=r"link 1 is 1\d{3} m long in this table\s+write urdf"):
        dh_table_text(robot, "mdh-hayati")
