"""Robots with a prismatic joint in their files: mm in robot file and DH table, m in a URDF; columns of data sets."""

import numpy as np
import pytest

from cellctl.files import InputError, sha256_of
from cellctl.formats.dataset import DataSet, Sieve, joint_readings
from cellctl.formats.description import RobotDescription, robot_text
from cellctl.formats.dh_table import dh_table_text, load_dh_table
from cellctl.formats.urdf import load_urdf, urdf_text
from cellctl.operations.exporting import ExportOptions, exported, read_source
from cellctl.robot_file import RobotFile
from tests.helpers.arms import KR5_FILE
from tests.helpers.own_model import assert_same_pose, forward_of_dh_table, forward_of_urdf
from tests.helpers.sliding_robots import KINDS, sliding_robot_text

TABLE = """\
name: two joints
convention: mdh-hayati
links:
  - {theta: 0, d: 100, a: 50, alpha: 90}
  - {theta: 0, d: 30, a: 400, alpha: 0}
joints:
  - {type: prismatic, offset: 500, min: 0, max: 2000, max_speed: 800}
  - {min: -180, max: 180, max_speed: 100}
repeatability: 0.05
"""


def robot_of(tmp_path, text, name="robot.yaml"):
    (tmp_path / name).write_text(text)
    return RobotFile.load(tmp_path / name)


def refusal(call, *words):
    with pytest.raises(InputError) as caught:
        call()
    text = " ".join(f"{each.line}: {each.what} {each.cure}" for each in caught.value.problems)
    assert all(word in text for word in words), text
    return caught.value.problems


@pytest.fixture(params=KINDS)
def robot(request, tmp_path):
    return robot_of(tmp_path, sliding_robot_text(request.param))


def readings_of(robot, count=6):
    low, high = np.clip(robot.limits(), -170.0, None).T
    return np.random.default_rng(1).uniform(low, high, (count, robot.n))


def assert_same_robot(found, robot):
    assert [joint.prismatic for joint in found.joints] == [joint.prismatic for joint in robot.joints]
    for readings in readings_of(robot):
        wanted = robot.chain().forward(robot.joint_map().model(readings))
        assert_same_pose(found.chain.forward(found.joint_map().model(readings)), wanted)


@pytest.mark.parametrize("convention", ["mdh-hayati", "dh-craig", "poe"])
def test_every_robot_file_has_the_tool_at_the_same_place(robot, convention, tmp_path):
    text = robot_text(RobotDescription.of(robot), convention, "test")
    assert_same_robot(RobotDescription.of(robot_of(tmp_path, text, "other.yaml")), robot)


def test_a_urdf_has_metres_and_comes_back_as_the_same_robot(robot, tmp_path):
    text = urdf_text(RobotDescription.of(robot))
    (tmp_path / "robot.urdf").write_text(text)
    back = load_urdf(tmp_path / "robot.urdf")
    assert_same_robot(back, robot)
    (number,) = robot.prismatic
    assert back.joints[number - 1].max == robot.joints[number - 1].max
    assert f'upper="{robot.joints[number - 1].max / 1000:g}"' in text
    in_urdf = np.where(robot.joint_map().prismatic, 1e-3, np.deg2rad(1.0))
    for readings in readings_of(robot):
        wanted = robot.chain().forward(robot.joint_map().model(readings))
        assert_same_pose(forward_of_urdf(text, "tcp", readings * in_urdf), wanted)


@pytest.mark.parametrize("convention", ["mdh-hayati", "dh-craig"])
def test_a_dh_table_names_the_kind_of_each_joint(robot, convention, tmp_path):
    text = dh_table_text(RobotDescription.of(robot), convention)
    (tmp_path / "robot.csv").write_text(text)
    assert_same_robot(load_dh_table(tmp_path / "robot.csv"), robot)
    for readings in readings_of(robot):
        wanted = robot.chain().forward(robot.joint_map().model(readings))
        assert_same_pose(forward_of_dh_table(text, readings), wanted)


def test_files_of_revolute_joints_do_not_mention_kinds(tmp_path):
    robot = robot_of(tmp_path, TABLE.replace("type: prismatic, offset: 500, ", ""))
    assert "type" not in str(robot.model_dump())
    assert "type" not in dh_table_text(RobotDescription.of(robot), "mdh-hayati")
    assert "prismatic" in str(robot_of(tmp_path, TABLE).model_dump())


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("max: 2000", "max: 2", 7, "looks like metres"),
        ("type: prismatic", "type: linear", 7, "revolute"),
        ("type: prismatic, offset: 500", "offset: 500", 7, "offset 500 is not from -360 to 360"),
    ],
)
def test_a_wrong_joint_is_refused_where_it_stands(tmp_path, old, new, line, words):
    problems = refusal(lambda: robot_of(tmp_path, TABLE.replace(old, new)), words)
    assert [each.line for each in problems] == [line]


def columns(robot, rows, letter="A"):
    names = ",".join(f"{letter}{number}" for number in range(1, robot.n + 1))
    text = "\n".join([names, *(",".join(map(str, row)) for row in rows)])
    return Sieve(DataSet.parse(text, "data.csv"))


def test_a_prismatic_joints_column_is_mm_beside_degrees_and_m_beside_radians(tmp_path):
    robot = robot_of(tmp_path, TABLE)
    np.testing.assert_allclose(joint_readings(columns(robot, [[1500, 90]]), robot), [[1500, 90]])
    in_si = joint_readings(columns(robot, [[1.5, np.pi / 2]], "q"), robot)
    np.testing.assert_allclose(in_si, [[1500, 90]])


def test_a_reading_beyond_the_travel_is_rejected_in_mm(tmp_path):
    robot = robot_of(tmp_path, TABLE)
    sieve = columns(robot, [[1500, 90], [2100, 90]])
    joint_readings(sieve, robot)
    assert [(each.line, each.reason) for each in sieve.rejected()] == [(3, "A1 is 2100 mm, outside 0…2000 mm")]


def test_mm_in_a_column_of_metres_is_refused_with_the_cure(tmp_path):
    robot = robot_of(tmp_path, TABLE)
    rows = columns(robot, [[1500, 1.0], [300, 0.5], [900, -1.0]], "q")
    refusal(lambda: joint_readings(rows, robot), "q1 is mm", "3 of 3 rows", "name the columns A1…A2")


@pytest.mark.parametrize("form", ["kuka", "abb", "fanuc", "ur-calibration"])
def test_forms_of_controllers_are_refused_by_name(tmp_path, form):
    robot_of(tmp_path, TABLE)
    source = read_source(tmp_path / "robot.yaml", None, None, None)
    refusal(lambda: exported(source, form, ExportOptions()), "joint 1 of two joints is prismatic", f"--to {form}")


def test_the_hash_of_a_robot_file_in_older_models_still_holds():
    assert sha256_of(RobotFile.load(KR5_FILE).model_dump()).startswith("75e402498876")
