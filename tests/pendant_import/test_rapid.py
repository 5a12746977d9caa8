"""RAPID modules: jointtargets are postures, robtargets are targets; what is neither in numbers is named by line."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellctl.pendant_import import Choices
from cellctl.pendant_import._joint_list import joint_points, joint_texts
from cellctl.pendant_import._programs import program_targets

A = [f"A{number}" for number in range(1, 7)]
NONE = "[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]"

MODULE = f"""\
%%%
  VERSION:1
  LANGUAGE:ENGLISH
%%%
MODULE Messung
  ! old: CONST jointtarget p0:=[[9,9,9,9,9,9],{NONE}];
  CONST jointtarget p10:=[[12.5,-80,65,0,40,0],{NONE}];
  LOCAL PERS JOINTTARGET p20:=[
      [-30,-95.2,1.5E+01,15,-35,-8.5e1],
      [9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST robtarget r1:=[[568,190,300],[0,0.707107,-0.707107,0],[-1,0,-1,0],{NONE}];
  CONST robtarget r2:=[[600,190,300.25],[1,0,0,0],[0,0,0,0],{NONE}];
  VAR jointtarget grid{{2}}:=[[[1,2,3,4,5,6],{NONE}],[[7,8,9,10,11,12],{NONE}]];
  VAR jointtarget later;
  PERS tooldata probe:=[TRUE,[[0,0,120],[1,0,0,0]],[1.5,[0,0,50],[1,0,0,0],0,0,0]];
  CONST jointtarget made:=CalcJointT(r1,probe);
  CONST string said:="CONST jointtarget no:=[[9,9,9,9,9,9],[9E9,9E9,9E9,9E9,9E9,9E9]];";
  PROC main()
    MoveAbsJ [[0,0,0,0,30,0],{NONE}]\\NoEOffs, v100, fine, tool0; ! home
    p30:=[[1,1,1,1,1,61],{NONE}];
    MoveL r1, v100, fine, probe\\WObj:=fixture;
    MoveJ r2, v100, z10, probe;
  ENDPROC
ENDMODULE
"""


def read(text):
    return joint_points(joint_texts(text, "m.mod", Choices(), None, ()), Choices(), None)


def good(points):
    return {point.name: [point.values[name] for name in A] for point in points.points if not point.fault}


def test_jointtargets_declared_assigned_in_arrays_and_in_instructions_are_postures_in_degrees():
    points = read(MODULE)
    assert good(points) == {
        "p10": [12.5, -80, 65, 0, 40, 0],
        "p20": [-30, -95.2, 15, 15, -35, -85],
        "grid{1}": [1, 2, 3, 4, 5, 6],
        "grid{2}": [7, 8, 9, 10, 11, 12],
        "": [0, 0, 0, 0, 30, 0],
        "p30": [1, 1, 1, 1, 1, 61],
    }
    assert [point.line for point in points.points if not point.fault] == [7, 8, 13, 13, 19, 20]


def test_robtargets_and_points_without_numbers_are_named_by_line_among_the_postures():
    faults = {point.line: (point.name, point.fault) for point in read(MODULE).points if point.fault}
    assert sorted(faults) == [11, 12, 14, 16]
    assert faults[11] == ("r1", "robtarget is Cartesian: joint readings are needed")
    assert "not taught" in faults[14][1]
    assert "not a jointtarget in numbers" in faults[16][1]


def test_robtargets_are_targets_in_the_work_object_of_the_instruction_that_moves_to_them():
    raw = program_targets(MODULE, "m.mod").raw
    assert {point.name: dict(point.texts) for point in raw.points if not point.fault} == {
        "r1": {"X": "568", "Y": "190", "Z": "300", "QW": "0", "QX": "0.707107", "QY": "-0.707107", "QZ": "0"}
        | {"frame": "fixture"},
        "r2": {"X": "600", "Y": "190", "Z": "300.25", "QW": "1", "QX": "0", "QY": "0", "QZ": "0", "frame": "wobj0"},
    }


def test_a_robtarget_that_is_used_in_two_work_objects_is_no_target():
    text = MODULE.replace("MoveJ r2,", "MoveJ r1,")
    faults = {point.name: point.fault for point in program_targets(text, "m.mod").raw.points if point.fault}
    assert faults["r1"] == "robtarget of moves in several work objects: fixture and wobj0"


def test_an_additional_axis_that_moves_is_kept_and_one_that_is_absent_is_not():
    rows = "".join(f"CONST jointtarget p{n}:=[[1,20,3,4,5,6],[{n}00,9E9,5,9E9,9E9,9E9]];\n" for n in (1, 2))
    points = read(rows)
    assert [point.values.get("E1") for point in points.points] == [100, 200]
    assert not any("E2" in point.values or "E3" in point.values for point in points.points)
    assert any("E1 not the same" in said for said in points.decided)


@pytest.mark.parametrize(
    "value", ["[[1,2,3,4,5],[9E9,9E9,9E9,9E9,9E9,9E9]]", "[[1,2,3,4,5,a6],[9E9,9E9,9E9,9E9,9E9,9E9]]", "[[1,2,3"]
)
def test_a_jointtarget_with_too_few_numbers_is_named_and_the_others_are_read(value):
    points = read(f"CONST jointtarget p1:={value};\nCONST jointtarget p2:=[[1,20,3,4,5,6],{NONE}];\n")
    assert points.points[0].fault == "is not a jointtarget in numbers: lists of 6 and 6 are needed"
    assert good(points) == {"p2": [1, 20, 3, 4, 5, 6]}


ANGLES = st.lists(st.floats(-185, 185, allow_subnormal=False).map(lambda x: round(x, 9)), min_size=6, max_size=6)


@given(
    st.lists(ANGLES, min_size=1, max_size=6),
    st.sampled_from([repr, "{:.9f}".format, "{:.14E}".format]),
    st.sampled_from([",", ", ", " ,\n  "]),
    st.sampled_from(["\n", "\r\n"]),
    st.sampled_from(["CONST jointtarget ", "LOCAL VAR JointTarget ", "TASK PERS jointtarget "]),
)
def test_jointtargets_come_back_as_they_were_written(rows, form, comma, newline, declared):
    bodies = [comma.join(map(form, row)) for row in rows]
    text = "".join(f"{declared}p{n}:=[[{body}],{NONE}];{newline}" for n, body in enumerate(bodies, 1))
    assert good(read(text)) == {f"p{n}": row for n, row in enumerate(rows, 1)}


@given(st.text(alphabet='[]{},;:="!\\ \n1.5eE+-pCONSTjointarge', max_size=200))
def test_any_text_with_a_point_type_in_it_is_read_without_an_exception(text):
    assert program_targets(f"CONST jointtarget {text}", "m.mod") is not None


def test_other_data_with_as_many_numbers_as_a_posture_is_none():
    text = "VAR num m{2,6};\nPERS num n{2,6}:=[[1,2,3,4,5,66],[1,2,3,4,5,6]];\nm:=[[1,2,3,4,5,66],[1,2,3,4,5,6]];\n"
    points = read(f"{text}n{{1}}:=[[1,2,3,4,5,66],[1,2,3,4,5,6]];\nCONST jointtarget p2:=[[1,20,3,4,5,6],{NONE}];\n")
    assert good(points) == {"p2": [1, 20, 3, 4, 5, 6]}


def test_a_krl_file_that_speaks_of_robtargets_in_a_comment_stays_krl():
    text = "; converted from a robtarget\nDECL E6AXIS XP1={A1 1.0,A2 20.0,A3 3.0,A4 4.0,A5 5.0,A6 6.0}\n"
    assert read(text).source.name == "krl"
