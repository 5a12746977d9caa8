"""Joint lists of pendants and spreadsheets: read to the last digit, or named with line and reason."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellctl.files import InputError
from cellctl.formats import RobotFile
from cellctl.pendant_import import Choices
from cellctl.pendant_import._joint_list import joint_points, joint_texts

ROBOT = RobotFile.model_validate(
    {
        "name": "six joints",
        "convention": "mdh-hayati",
        "links": [{"d": 100.0, "alpha": 90.0}] * 6,
        "joints": [{"min": -185.0, "max": 185.0, "max_speed": 100.0}] * 6,
        "repeatability": 0.03,
    }
)
A = [f"A{number}" for number in range(1, 7)]
Q = [f"q{number}" for number in range(1, 7)]


def read(text, robot=None, **choices):
    given_ = Choices(**choices)
    return joint_points(joint_texts(text, "list", given_, robot, ()), given_, robot)


def values(points, names):
    return [[point.values[name] for name in names] for point in points.points if not point.fault]


def faults(points):
    return {point.line: point.fault for point in points.points if point.fault}


KRL = """\
&ACCESS RVP\r
DEFDAT  MESSUNG PUBLIC\r
;FOLD PTP P1 CONT Vel=100 % PDAT1 {A1 9} Prüfkörper\r
DECL E6AXIS XP1={A1 0.0,A2 -90.0,A3 90.0,A4 0.0,A5 0.0,A6 0.0,E1 0.0,E2 0.0}\r
DECL FDAT FP1={TOOL_NO 1,BASE_NO 0,IPO_FRAME #BASE,POINT2[] " ",TQ_STATE FALSE}\r
DECL PDAT PPDAT1={VEL 100.000,ACC 100.000,APO_DIST 100.000}\r
GLOBAL\tE6AXIS  XP2 = { A1 1.5E+01 ,\tA2 -9.05e1, A3 90,A4 0.0,A5 0.0,A6 -0.5}\r
decl axis p[3]={axis: a1 1,a2 2,a3 3,a4 4,a5 5,a6 66}\r
DECL E6POS XP4={X 1000.0,Y 0.0,Z 1.2,A 0.0,B 90.0,C 0.0,S 2,T 35,E1 0.0}\r
DECL FRAME F5={X 1,Y 2,Z 3,A 4,B 5,C 6}\r
DECL E6AXIS XP6={A1 1.0,A2 2.0\r
DECL E6AXIS XP7={A1 1,5,A2 2.0,A3 3.0,A4 4.0,A5 5.0,A6 6.0}\r
DECL E6AXIS XP8={A1 1.0,A2 2.0,A3 3.0,A4 4.0,A6 6.0}\r
DECL E6AXIS XP9\r
DECL E6AXIS XP10={A1 1.0,A2 abc,A3 3.0,A4 4.0,A5 5.0,A6 6.0}\r
ENDDAT\r
"""


def test_a_krl_data_list_gives_its_joint_points_in_degrees():
    points = read(KRL, ROBOT)
    assert [point.name for point in points.points if not point.fault] == ["XP1", "XP2", "p[3]"]
    assert values(points, A) == [[0, -90, 90, 0, 0, 0], [15, -90.5, 90, 0, 0, -0.5], [1, 2, 3, 4, 5, 66]]


def test_krl_points_that_are_no_joint_readings_are_named_by_line():
    found = faults(read(KRL))
    assert sorted(found) == [9, 10, 11, 12, 13, 14, 15]
    assert "E6POS is Cartesian" in found[9]
    assert "FRAME is Cartesian" in found[10]
    assert "'}' is missing" in found[11]
    assert "decimal points" in found[12]
    assert "A5" in found[13]
    assert "not taught" in found[14]
    assert "A2 'abc' is not a number" in found[15]


def test_a_point_is_always_the_decimal_sign_of_krl():
    assert values(read("XP1={A1 1.234,A2 20.500}\n"), A[:2]) == [[1.234, 20.5]]


def test_an_axis_given_twice_makes_a_point_unusable():
    assert faults(read("XP1={A1 1.0,A2 20.0}\nXP2={A1 1.0,A1 2.0,A2 20.0}\n")) == {2: "A1 is given twice"}


ANGLES = st.lists(st.floats(-185, 185, allow_subnormal=False).map(lambda x: round(x, 9)), min_size=6, max_size=6)


@given(
    st.lists(ANGLES, min_size=1, max_size=8),
    st.sampled_from(["\n", "\r\n", "\r"]),
    st.sampled_from([repr, "{:.9f}".format, "{:.14E}".format]),
    st.sampled_from([",", ", ", " ,\t"]),
    st.sampled_from(["DECL E6AXIS ", "DECL GLOBAL E6AXIS\t", "  decl axis ", "E6AXIS ", ""]),
)
def test_krl_points_come_back_as_they_were_written(rows, newline, form, comma, declared):
    bodies = [comma.join(f"A{place} {form(value)}" for place, value in enumerate(row, 1)) for row in rows]
    text = newline.join(f"{declared}XP{place}={{{body}}} ; Höhe" for place, body in enumerate(bodies, 1))
    points = read(text, ROBOT)
    assert [point.name for point in points.points] == [f"XP{place}" for place in range(1, len(rows) + 1)]
    assert values(points, A) == rows


@pytest.mark.parametrize(
    "text",
    [
        "$AXIS_ACT={E6AXIS: A1 1.0,A2 -2.0,A3 3.0,A4 4.0,A5 5.0,A6 60.0,E1 0.0}\n",
        "A1 1.0, A2 -2.0, A3 3.0, A4 4.0, A5 5.0, A6 60.0\n",
        "A1=1,0 A2=-2,0 A3=3,0 A4=4,0 A5=5,0 A6=60,0\n",
        "A1: 1.0°\nA2: -2.0°\nA3: 3.0 deg\nA4: 4.0\nA5: 5.0\nA6: 60.0\n",
        "$AXIS_ACT.A1=1.0\n$AXIS_ACT.A2=-2.0\n$AXIS_ACT.A3=3\n$AXIS_ACT.A4=4\n$AXIS_ACT.A5=5\n$AXIS_ACT.A6=60\n",
    ],
)
def test_listings_of_axis_act_in_every_shape_give_the_same_posture(text):
    points = read(text + text)
    assert values(points, A) == [[1, -2, 3, 4, 5, 60]] * 2
    assert not points.named


def test_other_system_variables_are_not_taken_for_postures():
    points = read("$AXIS_ACT={A1 1,A2 20}\n$AXIS_INC={A1 100,A2 200}\n$H_POS={A1 1,A2 2}\n")
    assert values(points, A[:2]) == [[1, 20]]
    assert sorted(faults(points)) == [2, 3]


def test_names_above_or_before_the_axes_name_the_posture():
    points = read("P1\nA1 1\nA2 2\n\nP2\nA1 3\nA2 40\nP3: A1 5 A2 60\n")
    assert [point.name for point in points.points] == ["P1", "P2", "P3"]
    assert values(points, A[:2]) == [[1, 2], [3, 40], [5, 60]]


SCRIPT = """\
def prog():
  set_tcp(p[0.0,0.0,0.1,0.0,0.0,0.0])   # [1,2,3,4,5,6]
  set_payload(1.5, [0.0, 0.0, 0.05])
  global Waypoint_1_p=p[.1, .2, .3, 0.1, -1.2, 3.1]
  global Waypoint_1_q=[-1.6, -1.7, -2.2, -0.8, 1.59, -3e-2]
  movej([0.1, 0.2, 0.3, d2r(90), 1, 2], a=1.4, v=1.05)
  movel(p[0.1, 0.2, 0.3, 0, 1, 2], a=1.4, v=1.05)
  speedj([0.1, 0.2, 0.3, 0, 1, 2], 0.5)
  movej([0.1, 0.2,
    0.3, 0, 1, 20])
end
"""


def test_a_ur_script_gives_its_joint_lists_in_radians_and_names_its_poses():
    points = read(SCRIPT, ROBOT)
    assert values(points, Q) == [[-1.6, -1.7, -2.2, -0.8, 1.59, -0.03], [0.1, 0.2, 0.3, math.radians(90), 1, 2]]
    assert [point.name for point in points.points] == ["Waypoint_1", "", "", ""]
    assert "Cartesian" in faults(points)[7]
    assert "no angle in radians" in faults(points)[9]


def test_plain_lists_of_lists_are_postures_in_their_order():
    points = read("[[0.1, -1.2, 0, 0, 0, 0],\n [0.2, -1.3, 0, 0, 0, 1.5e-1]]")
    assert [point.line for point in points.points] == [1, 2]
    assert values(points, Q) == [[0.1, -1.2, 0, 0, 0, 0], [0.2, -1.3, 0, 0, 0, 0.15]]


@pytest.mark.parametrize(
    "heading",
    [
        "A1;A2;A3",
        "J1;J2;J3",
        "Joint 1;Joint 2;Joint 3",
        "joint_1;joint_2;joint_3",
        "A1 [°];A2 [°];A3 [°]",
        "Achse 1 (Grad);Achse 2 (Grad);Achse 3 (Grad)",
    ],
)
def test_a_table_in_degrees_under_every_heading(heading):
    points = read(f"Nr.;{heading}\n1;10,5;-20;30\n2;11,5;-21;31\n")
    assert values(points, A[:3]) == [[10.5, -20, 30], [11.5, -21, 31]]
    assert [point.name for point in points.points] == ["1", "2"]


def test_columns_are_taken_by_heading_not_by_place():
    assert values(read("A3 A1 A2\n30 10 20\n31 11 21\n"), A[:3]) == [[10, 20, 30], [11, 21, 31]]


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("J1;J2;J3\n0,1;0,2;1,57\n", None),
        ("A1;A2;A3\n0,1;0,2;1,57\n", None),
        ("q1;q2;q3\n10;20;30\n", None),
        ("J1 [rad];J2 [deg];J3 [rad]\n0,1;0,2;1,5\n", None),
        ("J1 [rad];J2 [rad];J3 [rad]\n0,1;0,2;1,5\n", "deg"),
    ],
)
def test_degrees_or_radians_is_refused_where_name_and_numbers_do_not_agree(text, unit):
    with pytest.raises(InputError, match="--angles deg or --angles rad"):
        read(text, angles=unit)


def test_the_user_says_degrees_or_radians():
    text = "J1;J2;J3\n0,1;0,2;1,57\n"
    assert values(read(text, angles="rad"), Q[:3]) == values(read(text, angles="deg"), A[:3]) == [[0.1, 0.2, 1.57]]


def test_small_angles_that_the_file_calls_degrees_are_doubted_aloud():
    assert any("are they not radians?" in said for said in read("J1 [deg];J2 [deg];J3 [deg]\n0,1;0,2;1,5\n").decided)


def test_a_table_without_headings_needs_to_have_one_meaning():
    six = "P1 10 20 30 40 50 60\nP2 11 21 31 41 51 61\n"
    assert [point.name for point in read(six).points] == ["P1", "P2"]
    numbered = six.replace("P", "")
    assert values(read(numbered, ROBOT), A)[1] == [11, 21, 31, 41, 51, 61]
    with pytest.raises(InputError, match="--robot"):
        read(numbered)  # seven joints, or a number and six


def test_the_robot_file_says_how_many_joints_and_how_far_they_go():
    with pytest.raises(InputError, match="the robot file has 6 joints"):
        read("A1;A2;A3\n10;20;30\n", ROBOT)
    points = read("A1;A2;A3;A4;A5;A6\n10;20;30;40;50;60\n10;20;30;40;50;200\n", ROBOT)
    assert "A6 is 200°, outside -185…185°" in faults(points)[3]


def test_a_gap_among_the_joints_is_refused():
    with pytest.raises(InputError, match="A1, A2, A4"):
        read("A1;A2;A4\n10;20;30\n")


def test_external_axes_that_move_are_kept_and_said_those_that_stand_are_dropped():
    rows = "\n".join(f"XP{n}={{A1 1,A2 20,E1 {n},E2 5}}" for n in (1, 2))
    points = read(rows)
    assert points.points[0].values == {"A1": 1, "A2": 20, "E1": 1}
    assert any("E1 not the same" in said for said in points.decided)


def test_krl_values_alone_on_a_line_are_postures_and_a_damaged_point_is_named():
    points = read("{A1 1.0,A2 20.0}\nP2: {A1 3.0,A2 40.0}\nXP3={A1 5.0,A2 60.0} {\n")
    assert values(points, A[:2]) == [[1, 20], [3, 40]]
    assert [(point.name, point.line) for point in points.points if point.fault] == [("XP3", 3)]
