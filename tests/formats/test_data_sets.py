"""Data sets on normal days: a bad row is named and left out, a bad file is refused, nothing is guessed."""

import contextlib
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellctl.files import InputError
from cellctl.formats import Artefact, DataSet, RobotFile, measurements
from cellctl.formats.measurements import Spacing

ROBOT = RobotFile.model_validate(
    {
        "name": "two joints",
        "convention": "mdh-hayati",
        "links": [{"d": 100.0, "alpha": 90.0}, {"a": 300.0}],
        "joints": [{"min": -90.0, "max": 90.0, "max_speed": 100.0}] * 2,
        "tool": {"xyz": [0.0, 0.0, 50.0], "mass": 1.0},
        "repeatability": 0.03,
    }
)
SPHERES = Artefact.model_validate(
    {
        "tip_radius": 0.6,
        "spheres": [{"id": "S1", "diameter": 60.0, "centre": [1.0, 2.0, 3.0]}],
    }
)


def measured(text, **options):
    return measurements(ROBOT, DataSet.parse(text, "data.csv"), **options)


def test_degrees_and_radians_give_the_same_angles():
    degrees = measured("A1,A2,X,Y,Z\n30,-60,1,2,3\n").task.rows.only
    radians = measured(f"q1,q2,X,Y,Z\n{math.pi / 6!r},{-math.pi / 3!r},1,2,3\n").task.rows.only
    np.testing.assert_allclose(degrees.q, [[math.pi / 6, -math.pi / 3]])
    np.testing.assert_allclose(radians.q, degrees.q, atol=1e-15)


def test_sigma_is_the_rows_own_or_the_repeatability_on_one_axis():
    rows = measured("A1,A2,X,Y,Z,sX,sY,sZ\n1,2,3,4,5,0.1,0.2,0.3\n1,2,3,4,5,,,\n").task.rows.only
    np.testing.assert_allclose(rows.sigma, [[0.1, 0.2, 0.3], [0.03 / math.sqrt(3)] * 3])


def test_columns_may_stand_in_any_order_and_unknown_ones_are_kept(tmp_path):
    data = DataSet.parse('note,Z,A2,Y,A1,X\n"a, b",3,20,2,10,1\n', "data.csv")
    np.testing.assert_allclose(measurements(ROBOT, data).task.rows.only.xyz, [[1, 2, 3]])
    data.write(tmp_path / "again.csv")
    assert DataSet.load(tmp_path / "again.csv").texts("note") == ["a, b"]


AS_TYPED = "A1,A2,X,Y,Z,sphere\n1.5,-2,1003.25,4,5e-1,\n2.5,-2,3.125,4,5,\n"


@pytest.mark.parametrize(
    "text",
    [
        AS_TYPED.replace(",", ";"),
        AS_TYPED.replace(",", "\t"),
        AS_TYPED.replace(",", ";").replace(".", ","),
        AS_TYPED.replace(",", "\t").replace(".", ","),
        AS_TYPED.replace(",", ";").replace(".", ",").replace("1003", "1.003"),
        "sep=;\n" + AS_TYPED.replace(",", ";").replace(".", ","),
        AS_TYPED.replace(",\n", ",,,,\n").replace("sphere\n", "sphere,,,\n"),
        AS_TYPED.replace("sphere\n", "sphere,\n").replace(",\n", ",,\n", 1),
        AS_TYPED + ",,,,,\n,,,,,\n",
        AS_TYPED.replace("\n", "\r\n"),
    ],
)
def test_a_table_as_a_spreadsheet_saves_it_is_read(text):
    plain, read = DataSet.parse(AS_TYPED, "data.csv"), DataSet.parse(text, "data.csv")
    assert not read.rejected
    assert read.columns == plain.columns
    for name in plain.columns:
        assert [float(cell or "0") for cell in read.texts(name)] == [float(cell or "0") for cell in plain.texts(name)]


def test_a_name_with_a_comma_is_no_number():
    data = DataSet.parse("A1;A2;X;Y;Z;socket\n1,5;2,5;3;4;5;1,5\n", "data.csv")
    assert data.texts("socket") == ["1,5"]
    assert data.texts("A1") == ["1.5"]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
def test_a_data_set_is_read_in_whatever_a_spreadsheet_saved_it(tmp_path, encoding):
    (tmp_path / "data.csv").write_text("A1,A2,X,Y,Z,ort\n1,2,3,4,5,Süd\n", encoding=encoding)
    assert DataSet.load(tmp_path / "data.csv").texts("ort") == ["Süd"]


def test_an_old_workbook_is_named_as_such(tmp_path):
    (tmp_path / "data.xlsx").write_bytes(b"\xd0\xcf\x11\xe0" + bytes(range(256)))
    with pytest.raises(InputError, match="not text\n    save the sheet as CSV"):
        DataSet.load(tmp_path / "data.xlsx")


BAD_ROWS = """\
A1,A2,X,Y,Z
1,2,3,4,5
1,2,3,4
1,2,3,4,5,6
1,nan,3,4,5
1,2,three,4,5
1,2,3,,5
1,2,3,inf,5

200,2,3,4,5
1,"2",3,4,6
"""


def test_each_row_that_cannot_be_used_is_named_by_line_and_reason():
    found = measured(BAD_ROWS)
    assert found.lines == (2, 11)
    reasons = {row.line: row.reason for row in found.rejected}
    assert sorted(reasons) == [3, 4, 5, 6, 7, 8, 10]
    assert "4 cells for 5 columns" in reasons[3]
    assert "A2 is nan" in reasons[5]
    assert "X 'three' is not a number" in reasons[6]
    assert "Y is missing" in reasons[7]
    assert "outside -90…90" in reasons[10]


@pytest.mark.parametrize(
    ("header", "good", "bad"),
    [
        ("X,Y,Z", "3,4,5", "3,1e300,5"),
        ("X,Y,Z", "3,4,5", "3,-500001,5"),
        ("X,Y,Z,A,B,C", "3,4,5,6,7,8", "3,4,5,6,1e12,8"),
        ("sphere,radius", "S1,30", "S1,1e6"),
        ("sphere,radius,tip_radius", "S1,30,1", "S1,30,1e9"),
        ("sphere,radius,drift", "S1,30,0", "S1,30,-1e9"),
        ("anchor,distance", "bar,300", "bar,1e6"),
        ("X,Y,Z,temperature", "3,4,5,20", "3,4,5,1e7"),
        ("X,Y,Z,payload", "3,4,5,2", "3,4,5,1e7"),
        ("X,Y,Z,sX", "3,4,5,0.1", "3,4,5,1e7"),
    ],
)
def test_a_number_that_cannot_be_is_named_by_line(header, good, bad):
    found = measured(f"A1,A2,{header}\n1,2,{good}\n3,4,{bad}\n5,6,{good}\n")
    assert found.lines == (2, 4)
    assert "beyond 500000" in found.rejected[0].reason


def test_a_standard_deviation_of_nearly_nothing_silences_no_other_row():
    found = measured("A1,A2,X,Y,Z,sX\n1,2,3,4,5,1e-12\n3,4,3,4,6,1e-6\n")
    assert found.lines == (3,)
    assert "sX is 1e-12" in found.rejected[0].reason


def test_degrees_in_columns_of_radians_are_one_error_and_not_one_for_each_row():
    rows = "".join(f"{angle},{angle - 60},{angle},4,5\n" for angle in range(10, 50, 2))
    with pytest.raises(InputError) as refused:
        measured(f"q1,q2,X,Y,Z\n{rows}")
    (problem,) = refused.value.problems
    assert (problem.line, problem.what[:18]) == (1, "q1…q2 are degrees:")
    assert "A1…A2" in problem.cure


def test_radians_outside_the_limits_are_not_taken_for_degrees():
    rows = "".join(f"{1.8 + angle / 100},{0.5},{angle},4,5\n" for angle in range(10))
    found = measured(f"q1,q2,X,Y,Z\n{rows}0.1,0.2,3,4,5\n")
    assert found.lines == (12,)
    assert all("outside -90…90" in row.reason for row in found.rejected)


def test_a_row_that_equals_another_number_by_number_is_no_second_measurement():
    rows = "1,2,3,4,5,note\n1,2,3,4,5.01,note\n1.0,2,3,4,5.00,other\n1,2,3,4,x,note\n"
    found = measured(f"A1,A2,X,Y,Z,note\n{rows}")
    assert found.lines == (2, 3)
    assert [(row.line, row.reason[:17]) for row in found.rejected] == [
        (4, "the same as line "),
        (5, "Z 'x' is not a nu"),
    ]
    assert "line 2," in found.rejected[0].reason


def test_held_out_rows_cannot_be_copies_of_those_of_the_fit():
    found = measured("A1,A2,X,Y,Z,set\n1,2,3,4,5,fit\n1,2,3,4,5,test\n2,2,3,4,5,test\n")
    assert found.lines == (2, 4)


@pytest.mark.parametrize(
    ("column", "first", "second"), [("temperature", 20, 21), ("D1", 1, -1), ("payload", 0, 5), ("time", 10, 11)]
)
def test_the_same_numbers_under_other_conditions_are_another_measurement(column, first, second):
    assert len(measured(f"A1,A2,X,Y,Z,{column}\n1,2,3,4,5,{first}\n1,2,3,4,5,{second}\n").lines) == 2


def test_the_only_row_of_a_point_is_named_and_left_out():
    rows = "1,2,S1,30\n2,3,S1,30\n3,4,Sl,30\n4,5,S2,30\n5,6,S2,30\n"
    found = measured(f"A1,A2,sphere,radius\n{rows}")
    assert found.task.points == ("S1", "S2")
    assert [(row.line, row.reason) for row in found.rejected] == [(4, "the only row of sphere 'Sl': mistyped?")]


def test_the_only_row_of_a_point_in_its_session_says_as_little():
    rows = "1,2,P,Mon\n2,3,P,Mon\n3,4,P,Tue\n4,5,Q,Tue\n5,6,Q,Tue\n"
    (rejected,) = measured(f"A1,A2,socket,session\n{rows}").rejected
    assert (rejected.line, rejected.reason) == (4, "the only row of socket 'P' in session 'Tue': mistyped?")
    assert not measured(f"A1,A2,socket,session\n{rows}", own=frozenset()).rejected


def test_a_socket_seen_once_says_something_where_its_distance_from_another_is_known():
    rows = "1,2,P\n2,3,P\n3,4,Q\n"
    assert [row.line for row in measured(f"A1,A2,socket\n{rows}").rejected] == [4]
    assert not measured(f"A1,A2,socket\n{rows}", spacings=[Spacing(("P", "Q"), 50.0, 0.01)]).rejected


def test_digits_that_only_python_reads_as_a_number_are_text():
    found = measured("A1,A2,X,Y,Z\n1,2,3,4,5\n1,2,1_000,4,5\n")
    assert "1_000" in found.rejected[0].reason


def test_a_row_after_a_cell_with_a_line_break_keeps_its_own_line():
    found = measured('A1,A2,X,Y,Z,note\n1,2,3,4,5,"two\nlines"\n1,x,3,4,5,\n')
    assert found.lines == (2,)
    assert [row.line for row in found.rejected] == [4]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty"),
        ("\n\n", "is empty"),
        ("A1,A2,X,Y,Z\n", "holds no rows"),
        ("A1|A2|X|Y|Z\n1|2|3|4|5\n", "data-sets.md"),
        ("1,2,3,4,5\n2,3,4,5,6\n", "no header"),
        ("A1;A2;X;Y;Z\n1;2;3,5;4.5;5\n", "data.csv:2: '3,5' has a decimal comma"),
        ("A1;A2;X;Y;Z\n1;2;1,234;2,345;5\n", "may be 1234 or 1.234"),
        ("A1,A1,X,Y,Z\n1,2,3,4,5\n", "more than once"),
        ("A1,X,Y,Z\n1,3,4,5\n", "missing: A2"),
        ("A1,A2,q1,q2,X,Y,Z\n1,2,1,2,3,4,5\n", "both"),
        ("A1,A2,X,Y\n1,2,3,4\n", "column Z"),
        ("A1,A2,X,Y,Z\n1,2,3,4,nan\n", "no row that can be used"),
        ("A1,A2,anchor\n1,2,P1\n", "column distance"),
        ("A1,A2,sphere\n1,2,S1\n", "--artefact"),
    ],
)
def test_a_file_that_cannot_be_used_is_refused_and_says_why(text, words):
    with pytest.raises(InputError, match=words):
        measured(text)


def test_files_that_cannot_be_read_are_refused(tmp_path):
    (tmp_path / "picture.csv").write_bytes(b"\x89PNG\x00\x01\n1\n")
    for name in ("missing.csv", "picture.csv", "."):
        with pytest.raises(InputError):
            DataSet.load(tmp_path / name)


def test_a_byte_order_mark_is_no_part_of_the_first_name(tmp_path):
    (tmp_path / "bom.csv").write_bytes(b"\xef\xbb\xbfA1,A2,X,Y,Z\r\n1,2,3,4,5\r\n")
    assert DataSet.load(tmp_path / "bom.csv").columns[0] == "A1"


def test_touches_take_size_and_place_from_the_artefact():
    rows = "".join(f"{angle},2,S1\n" for angle in range(5))
    found = measured(f"A1,A2,sphere\n{rows}", artefact=SPHERES)
    assert found.measure == "sphere"
    np.testing.assert_allclose(found.task.rows.only.reach, 30.6)
    np.testing.assert_allclose(found.task.rough, [[1, 2, 3]])
    assert found.task.model.effects


def test_touches_of_unknown_or_contradicting_spheres_are_named():
    text = "A1,A2,sphere,radius\n1,2,S1,30\n1,2,S7,30\n1,2,,30\n1,2,S1,25\n"
    reasons = [row.reason for row in measured(text, artefact=SPHERES).rejected]
    assert ["S7" in reasons[0], "missing" in reasons[1], "25" in reasons[2]] == [True] * 3


def test_a_radius_column_alone_will_do():
    found = measured("A1,A2,sphere,radius\n1,2,B,25\n")
    assert found.task.rows.only.reach.tolist() == [25.0]
    assert found.task.rough is None


def test_the_tips_radius_comes_from_its_column_unless_an_artefact_knows_it():
    text = "A1,A2,sphere,radius,tip_radius\n1,2,S1,30,0.6\n1,2,S1,30,\n"
    assert measured(text).task.rows.only.reach.tolist() == [30.6, 30.0]
    assert measured(text, artefact=SPHERES).task.rows.only.reach.tolist() == [30.6, 30.6]


def test_a_tip_radius_that_contradicts_the_artefact_is_named():
    text = "A1,A2,sphere,radius,tip_radius\n1,2,S1,30,0.6\n1,2,S1,30,0.5\n1,2,S1,30,-1\n"
    found = measured(text, artefact=SPHERES)
    assert found.lines == (2,)
    assert ["0.5, but the artefact says 0.6" in found.rejected[0].reason, "-1" in found.rejected[1].reason] == [
        True
    ] * 2


def test_orientation_may_be_angles_or_a_quaternion():
    angles = measured("A1,A2,X,Y,Z,A,B,C\n1,2,3,4,5,90,0,0\n")
    half = math.sqrt(0.5)
    quaternion = measured(f"A1,A2,X,Y,Z,QW,QX,QY,QZ\n1,2,3,4,5,{half},0,0,{half}\n1,2,3,4,5,1,1,0,0\n")
    assert angles.measure == quaternion.measure == "pose"
    np.testing.assert_allclose(angles.task.rows.only.poses, quaternion.task.rows.only.poses, atol=1e-12)
    assert "unit quaternion" in quaternion.rejected[0].reason


def test_an_orientation_in_two_ways_is_refused_unless_only_one_is_filled_or_none_is_asked_for():
    header, both = "A1,A2,X,Y,Z,A,B,C,QW,QX,QY,QZ\n", "1,2,3,4,5,0,0,0,1,0,0,0\n"
    with pytest.raises(InputError, match="two ways"):
        measured(header + both)
    assert measured(header + "1,2,3,4,5,0,0,0,,,,\n").measure == "pose"
    assert measured(header + both, measure="position").measure == "position"


def test_a_drift_that_leaves_nothing_of_the_sphere_is_named():
    found = measured("A1,A2,sphere,radius,drift\n1,2,B,25,0\n2,3,B,25,-25\n3,4,B,25,-1\n")
    assert found.lines == (2, 4)
    assert found.rejected[0].reason == "radius + tip radius + drift is 0"


def test_orientation_is_left_alone_where_positions_are_asked_for():
    found = measured("A1,A2,X,Y,Z,A,B,C\n1,2,3,4,5,oops,0,0\n", measure="position")
    assert not found.rejected


def test_a_set_that_is_neither_fit_nor_test_is_named():
    found = measured("A1,A2,X,Y,Z,set\n1,2,3,4,5,fit\n1,2,3,4,6,test\n1,2,3,4,7,tset\n1,2,3,4,8,\n")
    assert found.sets == ("fit", "test")
    assert [row.line for row in found.rejected] == [4, 5]


@given(st.lists(st.tuples(st.floats(-90, 90), st.floats(-1e4, 1e4)), min_size=1, max_size=20))
def test_records_come_back_from_their_text_bit_for_bit(values):
    records = [{"A1": a, "A2": 0.0, "X": x, "Y": 1.0, "Z": None} for a, x in values]
    data = DataSet.of_records(records)
    assert [float(text) for text in data.texts("A1")] == [a for a, _ in values]
    assert [float(text) for text in data.texts("X")] == [x for _, x in values]
    assert set(data.texts("Z")) == {""}


@given(st.text(max_size=200))
def test_no_text_whatever_ends_in_anything_but_a_data_set_or_a_named_error(text):
    with contextlib.suppress(InputError):
        assert measurements(ROBOT, DataSet.parse(text, "data.csv")).lines


@pytest.mark.parametrize(
    ("row", "line", "what"),
    [
        ('"1,2,3,4,5', 3, "a quote is opened and not closed"),
        ('"1"2,2,3,4,5', 3, "text follows a closing quote"),
        ("1" * 140_000, 3, "a cell is longer than any value can be"),
    ],
)
def test_what_is_not_csv_is_refused_at_its_line_in_our_words(row, line, what):
    with pytest.raises(InputError) as caught:
        DataSet.parse(f"A1,A2,X,Y,Z\n1,2,3,4,5\n{row}\n1,2,3,4,5\n", "data.csv")
    (problem,) = caught.value.problems
    assert (problem.line, problem.what) == (line, what)
    assert problem.cure
