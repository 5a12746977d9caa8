"""FANUC .LS programs: /POS in joint and in Cartesian representation, and J3 as the robot file needs it."""

import numpy as np
import pytest

from cellctl.files import InputError
from cellctl.formats import RobotFile
from cellctl.installed import shipped
from cellctl.pendant_import import Choices
from cellctl.pendant_import._joint_list import joint_points, joint_texts
from cellctl.pendant_import._programs import program_targets

M10 = RobotFile.load(shipped("robot")["m10ia"])
A = [f"A{number}" for number in range(1, 7)]
HEAD = "/PROG  MESS1\r\n/ATTR\r\nOWNER\t\t= MNEDITOR;\r\n/MN\r\n   1:J P[1] 100% FINE    ;\r\n/POS\r\n"


def joints(number, values, extra=""):
    first, second = (
        ",\t".join(f"J{n}={values[n - 1]:10.3f} deg" for n in range(low, low + 3)).replace(" 0.", "  .")
        for low in (1, 4)
    )
    return f"P[{number}]{{\r\n   GP1:\r\n\tUF : 0, UT : 1,\t\r\n\t{first},\r\n\t{second}{extra}\r\n}};\r\n"


def cartesian(number, frame=0, rest=""):
    return (
        f"P[{number}]{{\r\n   GP1:\r\n\tUF : {frame}, UT : 1,\t\tCONFIG : 'N U T, 0, 0, 0',\r\n"
        "\tX =   812.350  mm,\tY =  -245.100  mm,\tZ =   405.000  mm,\r\n"
        f"\tW =  -179.293 deg,\tP =      .500 deg,\tR =   -90.000 deg{rest}\r\n}};\r\n"
    )


def read(text, robot=None, **choices):
    given = Choices(**choices)
    return joint_points(joint_texts(text, "mess.ls", given, robot, ()), given, robot)


def values(points):
    return [[point.values[name] for name in A] for point in points.points if not point.fault]


def test_joint_positions_are_postures_and_the_others_are_named_by_line():
    untaught = cartesian(3).replace("812.350", "********")
    linear = joints(4, [0, 0, 0, 0, 0, 0]).replace("deg", "mm", 1)
    points = read(
        HEAD + joints(1, [12.5, -10, 5, -0.5, 40, 0]) + cartesian(2) + untaught + linear + "/END\r\n", j3="arm"
    )
    assert values(points) == [[12.5, -10, 5, -0.5, 40, 0]]
    assert [(point.name, point.line) for point in points.points] == [
        ("P[1]", 7),
        ("P[2]", 13),
        ("P[3]", 19),
        ("P[4]", 25),
    ]
    faults = [point.fault for point in points.points]
    assert faults[1] == "P[] is Cartesian: joint readings are needed"
    assert faults[2:] == ["X is ********: not taught", "J1 is not in degrees"]


def test_points_are_named_by_their_comments_only_if_each_has_its_own():
    both = joints(1, [1] * 6).replace("P[1]", 'P[1:"left"]') + joints(2, [2] * 6).replace("P[2]", 'P[2:"right"]')
    assert [point.name for point in read(HEAD + both, j3="arm").points] == ["left", "right"]
    same = both.replace("right", "left")
    assert [(point.name, point.remark) for point in read(HEAD + same, j3="arm").points] == [
        ("P[1]", "left"),
        ("P[2]", "left"),
    ]


def test_cartesian_positions_are_targets_in_their_user_frame_with_w_p_r_as_c_b_a():
    group = "\r\n   GP2:\r\n\tUF : 0, UT : 1,\r\n\tJ1=     3.000  mm"
    found = program_targets(HEAD + joints(1, [1] * 6) + cartesian(2, 3, f",\r\n\tE1=  100.000  mm{group}"), "mess.ls")
    assert found.orientation == "abc"
    assert [dict(point.texts) for point in found.raw.points if not point.fault] == [
        {"X": "812.350", "Y": "-245.100", "Z": "405.000", "A": "-90.000", "B": ".500", "C": "-179.293", "frame": "UF 3"}
    ]
    assert any("not GP2" in said for said in found.raw.decided)


def test_a_german_controllers_file_is_read():
    text = (HEAD + cartesian(1)).replace("CONFIG", "KONFIG")
    assert not program_targets(text, "mess.ls").raw.points[0].fault


def test_an_external_axis_that_moves_is_kept():
    text = HEAD + "".join(joints(n, [n] * 6, f",\r\n\tE1=  {n}00.000  mm") for n in (1, 2))
    assert [point.values["E1"] for point in read(text, j3="arm").points] == [100, 200]


SHOWN = [[0, 0, 0, 0, 0, 0], [0, 30, 0, 0, 0, 0], [0, 60, 0, 0, 0, 0]]
"""J2 moves, J3 shown at the horizontal: the forearm of a FANUC stays horizontal."""


def test_the_forearm_of_an_arm_that_shows_j3_against_the_horizontal_stays_horizontal_in_the_model():
    points = read(HEAD + "".join(joints(n, row) for n, row in enumerate(SHOWN, 1)), M10)
    assert any("J2 added" in said for said in points.decided)
    poses = M10.chain().forward(M10.joint_map().model(np.array(values(points))))
    np.testing.assert_allclose(poses[:, :3, :3], poses[:1, :3, :3].repeat(3, axis=0), atol=1e-9)
    assert np.ptp(poses[:, 2, 3]) > 100  # it did move


def test_j3_of_a_fanuc_program_is_never_taken_without_a_statement():
    text = HEAD + joints(1, [0, 30, 10, 0, 0, 0])
    with pytest.raises(InputError, match="J3 counts from the horizontal") as refused:
        read(text)
    assert "--j3 horizontal" in refused.value.problems[0].cure
    assert values(read(text, j3="horizontal")) == [[0, 30, 40, 0, 0, 0]]
    assert values(read(text, M10, j3="arm")) == [[0, 30, 10, 0, 0, 0]]


def test_a_table_for_such_an_arm_needs_the_same_statement():
    text = "A1;A2;A3;A4;A5;A6\n0;30;10;0;0;0\n5;-30;10;0;0;60\n"
    with pytest.raises(InputError, match="does J3 count from the horizontal"):
        read(text, M10)
    assert values(read(text, M10, j3="horizontal"))[1] == [5, -30, -20, 0, 0, 60]
    assert values(read(text, M10, j3="arm"))[1] == [5, -30, 10, 0, 0, 60]
