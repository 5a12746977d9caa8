"""Cartesian points of every language as targets: the same pose, whatever the notation of its orientation."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cellctl.files import InputError
from cellctl.formats import DataSet, RobotFile
from cellctl.formats.dataset import text_of
from cellctl.formats.targets import read_targets
from cellctl.installed import shipped
from cellctl.pendant_import import choices, imported_targets

UR10 = RobotFile.load(shipped("robot")["ur10"])


def krl(place, turn):
    a, b, c = turn.as_euler("ZYX", degrees=True)
    x, y, z = place
    return f"DECL E6POS XP1={{X {x:.9f},Y {y:.9f},Z {z:.9f},A {a:.12f},B {b:.12f},C {c:.12f},S 2,T 35,E1 0.0}}\n"


def rapid(place, turn):
    q = ",".join(f"{each:.15f}" for each in turn.as_quat(scalar_first=True))
    x, y, z = place
    return f"CONST robtarget p1:=[[{x:.9f},{y:.9f},{z:.9f}],[{q}],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n"


def script(place, turn):
    numbers = [*(each / 1000 for each in place), *turn.as_rotvec()]
    return f"p1_p = p[{', '.join(f'{each:.15f}' for each in numbers)}]\n"


def fanuc(place, turn):
    w, p, r = turn.as_euler("xyz", degrees=True)  # fixed axes
    x, y, z = place
    return (
        "/PROG T\n/POS\nP[1]{\n   GP1:\n\tUF : 0, UT : 1,\tCONFIG : 'N U T, 0, 0, 0',\n"
        f"\tX = {x:.9f} mm,\tY = {y:.9f} mm,\tZ = {z:.9f} mm,\n"
        f"\tW = {w:.12f} deg,\tP = {p:.12f} deg,\tR = {r:.12f} deg\n}};\n/END\n"
    )


LANGUAGES = {"krl": krl, "rapid": rapid, "script": script, "fanuc": fanuc}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("targets")


def targets(folder, text, **answers):
    path = folder / "points.txt"
    path.write_text(text)
    free = {name: answers.pop(name) for name in ("group", "frame") if name in answers}
    return imported_targets(path, choices(answers, **free))


def poses(found):
    return read_targets(DataSet.parse(text_of(found.records), "targets.csv"), UR10).poses


COORDINATE = st.floats(-3000, 3000).map(lambda x: round(x, 6))
QUATERNION = st.tuples(*[st.floats(-1, 1)] * 4).filter(
    lambda q: np.linalg.norm(q) > 0.1 and abs(Rotation.from_quat(q).as_matrix()[2, 0]) < 0.9999
)
"""Without a pitch of ±90°, at which SciPy writes rounded angles; the next test has it."""


@pytest.mark.parametrize("language", LANGUAGES)
@given(place=st.tuples(COORDINATE, COORDINATE, COORDINATE), quaternion=QUATERNION)
@settings(max_examples=40)
def test_a_pose_is_the_same_target_in_every_language(folder, language, place, quaternion):
    turn = Rotation.from_quat(quaternion)
    found = poses(targets(folder, LANGUAGES[language](place, turn)))
    np.testing.assert_allclose(found[0, :3, :3], turn.as_matrix(), atol=1e-9)
    np.testing.assert_allclose(found[0, :3, 3], place, atol=1e-6)


@pytest.mark.filterwarnings("ignore:Gimbal lock")  # of SciPy, which writes the examples
@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("pitch", [90, -90])
def test_a_tool_that_points_along_x_is_a_target_too(folder, language, pitch):
    turn = Rotation.from_euler("ZYX", [30, pitch, 0], degrees=True)
    text = LANGUAGES[language]((1, 2, 3), turn)
    np.testing.assert_allclose(poses(targets(folder, text))[0, :3, :3], turn.as_matrix(), atol=1e-8)


def test_names_stay_and_points_of_joints_are_left_out_by_line(folder):
    text = krl((1, 2, 3), Rotation.identity()) + "DECL E6AXIS XP2={A1 1.0,A2 2.0,A3 3.0,A4 4.0,A5 5.0,A6 6.0}\n"
    found = targets(folder, text)
    assert [record["name"] for record in found.records] == ["XP1"]
    assert [(row.line, row.reason) for row in found.left_out] == [(2, "E6AXIS holds joints: a target is Cartesian")]


def test_tool_and_base_data_of_a_krl_file_are_no_targets(folder):
    base = "BASE_DATA[1]={X 1.0,Y 2.0,Z 3.0,A 0.0,B 0.0,C 0.0}\nDECL FRAME F1={X 1.0,Y 2.0,Z 3.0,A 0.0,B 0.0,C 0.0}\n"
    found = targets(folder, base + krl((1, 2, 3), Rotation.identity()))
    assert [record["name"] for record in found.records] == ["XP1"]
    assert [(row.name, row.reason) for row in found.left_out] == [("F1", "FRAME is no point of a motion")]


def test_a_pose_in_a_krl_motion_is_a_target_in_the_base_of_the_motion(folder):
    motion = "DEF P()\n$BASE=BASE_DATA[3]\nLIN {X 1.0,Y 2.0,Z 3.0,A 0.0,B 90.0,C 0.0} C_DIS\nEND\n"
    found = targets(folder, motion)
    assert [record["B"] for record in found.records] == [90.0]
    assert "BASE 3, which has to be the model's frame" in found.decided[0]


def test_a_krl_program_whose_points_are_in_its_data_list_says_so(folder):
    with pytest.raises(InputError, match=r"of a KRL program: its \.dat"):
        targets(folder, "&ACCESS RVP\nDEF PART( )\nPTP XP1\nEND\n")


def test_a_krl_motion_to_a_part_of_a_pose_is_named(folder):
    text = krl((1, 2, 3), Rotation.identity()) + "LIN {X 100.0}\n"
    assert [(row.line, row.reason) for row in targets(folder, text).left_out] == [
        (2, "Y, Z, A, B, C missing: not a whole pose")
    ]


def in_frames(*frames):
    data = "".join(
        f"DECL FDAT FP{n}={{TOOL_NO 1,BASE_NO {base},IPO_FRAME #BASE}}\n" for n, base in enumerate(frames, 1)
    )
    return data + "".join(
        krl((n, 2, 3), Rotation.identity()).replace("XP1", f"XP{n}") for n in range(1, len(frames) + 1)
    )


def test_points_in_different_frames_are_refused_unless_the_user_chooses_one(folder):
    with pytest.raises(InputError, match="different frames: BASE 1, BASE 2"):
        targets(folder, in_frames(1, 2, 1))
    found = targets(folder, in_frames(1, 2, 1), frame="BASE 1")
    assert [record["name"] for record in found.records] == ["XP1", "XP3"]
    assert [(row.name, row.reason) for row in found.left_out] == [("XP2", "is in BASE 2")]
    assert "BASE 4, which has to be the model's frame" in targets(folder, in_frames(4, 4)).decided[0]
    with pytest.raises(InputError, match="no point in frame 'BASE 7'"):
        targets(folder, in_frames(1), frame="BASE 7")


def test_the_joints_of_the_same_waypoints_are_the_postures_if_all_have_them(folder):
    pose = "Waypoint_{0}_p = p[.{0}, .2, .3, 0, 1, 0]\n"
    joints = "Waypoint_{0}_q = [-1.6, -1.7, -2.2, -0.8, 1.59, -0.0{0}]\n"
    found = targets(folder, "".join((pose + joints).format(n) for n in (1, 2)))
    assert [(record["name"], record["X"], record["q6"]) for record in found.records] == [
        ("Waypoint_1", 100.0, -0.01),
        ("Waypoint_2", 200.0, -0.02),
    ]
    assert not found.left_out
    partly = targets(folder, (pose + joints).format(1) + pose.format(2))
    assert [set(record) for record in partly.records] == [{"name", *"XYZABC"}] * 2


def test_a_table_of_targets_needs_the_meaning_of_its_orientation(folder):
    text = "Name,X [mm],Y [mm],Z [mm],A,B,C\nT1,1000.5,2,3,10,20,30\n"
    with pytest.raises(InputError, match="a target needs an orientation"):
        targets(folder, text)
    found = targets(folder, text, orientation="abc")
    np.testing.assert_allclose(
        poses(found)[0, :3, :3], Rotation.from_euler("ZYX", [10, 20, 30], degrees=True).as_matrix(), atol=1e-12
    )


@pytest.mark.parametrize("answers", [{"orientation": "abc"}, {"unit": "mm"}, {"decimal": "comma"}, {"group": "A"}])
def test_options_that_a_language_answers_itself_are_refused(folder, answers):
    with pytest.raises(InputError, match="is a robot program"):
        targets(folder, rapid((1, 2, 3), Rotation.identity()), **answers)


def test_a_program_without_cartesian_points_says_so(folder):
    with pytest.raises(InputError, match="no Cartesian point that can be used"):
        targets(folder, "DECL E6AXIS XP2={A1 1.0,A2 2.0,A3 3.0,A4 4.0,A5 5.0,A6 6.0}\n")
