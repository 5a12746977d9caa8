"""A table of positions typed by hand: in mm, exactly, or refused with the question and the option that answers it."""

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellctl.files import InputError
from cellctl.pendant_import import Choices
from cellctl.pendant_import._positions import position_points, position_texts


def read(text, **choices):
    given_ = Choices(**choices)
    return position_points(position_texts(text, "p.csv", given_), given_)


def xyz(points):
    return [[point.values[axis] for axis in "XYZ"] for point in points.points if not point.fault]


HEADINGS = [
    ["X", "Y", "Z"],
    ["x", "y", "z"],
    ["X [{}]", "Y [{}]", "Z [{}]"],
    ["X/{}", "Y/{}", "Z/{}"],
    ["X-Koordinate ({})", "Y-Koordinate ({})", "Z-Koordinate ({})"],
    ["measured x in {}", "measured y in {}", "measured z in {}"],
    ["Ist_X [{}]", "Ist_Y [{}]", "Ist_Z [{}]"],
]
MICRONS = {"mm": 1000, "cm": 10_000, "m": 1_000_000}
ROWS = st.lists(st.tuples(*[st.integers(-3_000_000, 3_000_000)] * 3), min_size=4, max_size=12)


def written(microns, unit, sign):
    """A length of whole microns in another unit, with all its digits."""
    scale = MICRONS[unit]
    whole, part = divmod(abs(microns), scale)
    digits = f"{part:0{len(str(scale)) - 1}d}"
    return ("-" if microns < 0 else "") + f"{whole}{sign}{digits}"


@st.composite
def tables(draw):
    """Rows in microns, the text of their table, what a person would say of it, and whether there are names."""
    rows = draw(ROWS)
    separator, sign = draw(st.sampled_from([(mark, sign) for mark in ";\t, " for sign in ".," if mark + sign != ",,"]))
    heading = draw(st.sampled_from(HEADINGS))
    unit = draw(st.sampled_from(list(MICRONS)))
    named = draw(st.booleans())
    first = ["Punkt"] if named else []
    lines = [[f"P{n}"] * named + [written(value, unit, sign) for value in row] for n, row in enumerate(rows, 1)]
    if unit == "cm" or draw(st.booleans()):
        lines.insert(0, [*first, *(word.format(unit) for word in heading if separator != " " or " " not in word)])
    text = draw(st.sampled_from(["\n", "\r\n"])).join(separator.join(line) for line in lines)
    return rows, text, {"unit": unit, "decimal": "comma" if sign == "," else "point"}, named


@given(tables())
def test_a_table_in_every_style_gives_the_same_microns_or_is_refused(table):
    rows, text, said, named = table
    wanted = [[value / 1000 for value in row] for row in rows]
    for choices in ({}, said):
        with contextlib.suppress(InputError):
            points = read(text, **choices)
            assert xyz(points) == wanted
            assert [point.name for point in points.points] == [f"P{n}" * named for n in range(1, len(rows) + 1)]


@given(ROWS, st.sampled_from([";", "\t"]), st.sampled_from(".,"), st.sampled_from(list(MICRONS)))
def test_a_user_who_says_decimal_sign_and_unit_is_not_refused(rows, separator, sign, unit):
    lines = [separator.join(["Nr", "X", "Y", "Z"])]
    lines += [separator.join(["7", *(written(value, unit, sign) for value in row)]) for row in rows]
    points = read("\n".join(lines), unit=unit, decimal="comma" if sign == "," else "point")
    assert xyz(points) == [[value / 1000 for value in row] for row in rows]


FAR = "1;1000,5;0;0\n2;0;2000,5;0\n3;-1000;1000;300\n4;500;-700;100,5\n5;700;300;900\n6;-900;-300;200\n"


def test_a_spread_that_only_mm_can_have_needs_no_unit_and_is_reported():
    points = read("Nr;X;Y;Z\n" + FAR)
    assert xyz(points)[0] == [1000.5, 0, 0]
    assert any("mm: no unit is named" in said for said in points.decided)


def test_metres_without_a_unit_are_not_taken_as_mm_even_if_one_point_slipped():
    rows = "".join(f"{n};0,{n}5;1,{n};-0,{n}7\n" for n in range(1, 9)) + "9;1234;0,5;0,6\n"
    with pytest.raises(InputError, match="--unit"):
        read("Nr;X;Y;Z\n" + rows)
    assert xyz(read("Nr;X;Y;Z\n" + rows, unit="m"))[0] == [150, 1100, -170]


def test_inches_are_exact():
    assert xyz(read("X [inch];Y [inch];Z [inch]\n1,5;2;0,1\n")) == [[38.1, 50.8, 2.54]]


def test_units_in_a_row_of_their_own_under_the_headings():
    assert xyz(read("Nr;X;Y;Z\n;m;m;m\n1;1,5;2;0,1\n")) == [[1500, 2000, 100]]


@pytest.mark.parametrize(
    ("text", "choices", "said"),
    [
        ("Nr;X [m];Y;Z\n1;1,5;2;3\n", {}, "no unit for Y, Z"),
        ("Nr;X [m];Y [m];Z [m]\n1;1,5;2;3\n", {"unit": "mm"}, "headings say m, --unit says mm"),
        ("Nr;X;X gemessen;Y;Z\n1;1;2;3;4\n", {}, "2 columns could be X"),
        ("Nr;Ost;Nord;Hoch\n" + FAR, {}, "no heading says which column is which: Nr, Ost, Nord, Hoch"),
        ("P1;1;2;3;4;5;6\n", {"unit": "mm"}, "which is which is not certain"),
        ("1;2;3;4;5;6\n", {"unit": "mm"}, "which is which is not certain"),
        ("Nr;X;Y\n1;2;3\n", {"unit": "mm"}, "no column Z"),
        ("nur Text\n", {}, "no row with three numbers"),
    ],
)
def test_what_is_not_certain_is_refused(text, choices, said):
    with pytest.raises(InputError, match=said) as refused:
        read(text, **choices)
    assert all(problem.cure for problem in refused.value.problems)


def test_the_user_names_columns_that_no_heading_explains():
    points = read("Nr;Ost;Nord;Hoch\n" + FAR, columns={"X": "Nord", "Y": "Ost", "Z": "Hoch"})
    assert xyz(points)[1] == [2000.5, 0, 0]


def test_rows_that_cannot_be_used_keep_their_place_and_say_why():
    text = "Messung Halle 3\nNr;X;Y;Z\n1;1,5;;3\n2;x;2;3\n\n;;;\n3;1;2;3;4\n4;1;2;3;Spiegel gewackelt\n5;1;2\n"
    points = read(text, unit="mm")
    assert [(point.line, point.name, point.fault) for point in points.points] == [
        (3, "1", "Y is missing"),
        (4, "2", "X 'x' is not a number"),
        (7, "3", "5 cells for 4 columns"),
        (8, "4", ""),
        (9, "5", "Z is missing"),
    ]
    assert points.points[3].remark == "Spiegel gewackelt"
    assert any("line 1" in said for said in points.decided)


def test_decimal_commas_between_separating_commas_give_no_number():
    points = read("X,Y,Z\n1,5,2,5,3,5\n1,6,2,6,3,6\n", unit="mm")
    assert all("6 cells for 3 columns" in point.fault for point in points.points)


def test_decimal_commas_between_spaces_are_no_separators_and_no_thousands():
    assert xyz(read("1234,5 100 200,5\n1334,5 110 210,5\n", unit="mm")) == [[1234.5, 100, 200.5], [1334.5, 110, 210.5]]


def test_a_spreadsheets_thousands_and_separator_line_are_read():
    text = "sep=;\nNr;X;Y;Z\n1;1 234,5;-2 345,6;3 456,7\n2;1.234,5;1'234,5;0,5\n"
    assert xyz(read(text, unit="mm")) == [[1234.5, -2345.6, 3456.7], [1234.5, 1234.5, 0.5]]


ORIENTED = "Nr;X;Y;Z;A;B;C;QW;QX;QY;QZ\n1;1;2;3;10;20;30;1;0;0;0\n2;1;2;3;10;20;30;1;1;0;0\n"


def test_orientation_is_taken_only_when_the_user_says_what_it_means():
    plain = read(ORIENTED, unit="mm")
    assert plain.points[0].values.keys() == {"X", "Y", "Z"}
    assert any("A, B, C" in said and "--orientation" in said for said in plain.decided)
    assert read(ORIENTED, unit="mm", orientation="abc").points[0].values["C"] == 30
    turned = read(ORIENTED, unit="mm", orientation="quaternion")
    assert turned.points[0].values["QW"] == 1
    assert "no unit quaternion" in turned.points[1].fault


def test_a_cell_that_is_longer_than_csv_allows_is_read_or_refused_and_nothing_else():
    with pytest.raises(InputError):
        read("X [mm],Y [mm]\n" + "1" * 140_000 + ",2\n")
