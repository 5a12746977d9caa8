"""Point files of measuring software: names, units, σ, times and frames as the file states them, nothing guessed."""

import numpy as np
import pytest

from cellctl.files import InputError
from cellctl.kinematics import rotation_from_abc
from cellctl.pendant_import import Choices
from cellctl.pendant_import._positions import position_points, position_texts


def read(text, **choices):
    given = Choices(**choices)
    return position_points(position_texts(text, "p.txt", given), given)


def rows(points, *names):
    return [(point.name, *(point.values.get(name) for name in names)) for point in points.points if not point.fault]


def said(points):
    return "; ".join(points.decided)


SA_HEADER = "// SpatialAnalyzer 2023.2\n// Working Frame: A::WORLD\n// Cartesian, units: Millimeters\n"
SA = SA_HEADER + (
    "// Collection,  Group,  Point,  X,  Y,  Z,  Ux,  Uy,  Uz\n\n"
    "A, Main,  P1,  1203.451234,  -311.021111,  982.110222,  0.010000,  0.012000,  0.020000\n"
    "A, Main,  P2,  1412.770001,    45.180002,  601.530003,  0.012000,  0.014000,  0.022000\n"
)


def test_headings_units_and_frame_of_a_spatialanalyzer_export_are_in_its_comments():
    points = read(SA)
    assert rows(points, *"XYZ") == [
        ("P1", 1203.451234, -311.021111, 982.110222),
        ("P2", 1412.770001, 45.180002, 601.530003),
    ]
    for words in ("headings in the comment on line 4", "group A::Main", "Working Frame: A::WORLD", "as line 3 says"):
        assert words in said(points)


def test_uncertainties_of_unknown_coverage_become_sigmas_only_when_the_user_says_how_many_sigmas_they_are():
    assert rows(read(SA), "sX")[0] == ("P1", None)
    assert "UX, UY, UZ not taken: --coverage" in said(read(SA))
    assert rows(read(SA, coverage=2.0), "sX", "sY", "sZ", "UX")[0] == ("P1", 0.005, 0.006, 0.01, None)
    with pytest.raises(InputError, match="has no uncertainties"):
        read("Name;X [mm];Y [mm];Z [mm]\n1;1,5;2;3\n", coverage=2.0)


@pytest.mark.parametrize("heading", ["s{}", "sigma {}", "{} Sigma", "Std Dev {}", "Standard Deviation {}", "σ{}"])
def test_standard_deviations_are_taken_in_the_unit_of_their_heading(heading):
    spread = ",".join(f"{heading.format(axis)} [um]" for axis in "XYZ")
    points = read(f"Name,X [m],Y [m],Z [m],{spread}\nP1,1.2034,0.5,0.25,11,12,13.5\n")
    assert rows(points, "X", "sX", "sY", "sZ") == [("P1", 1203.4, 0.011, 0.012, 0.0135)]


def test_standard_deviations_without_a_unit_of_their_own_have_the_unit_of_the_positions():
    assert rows(read("Name,X [m],Y [m],Z [m],sX,sY,sZ\nP1,1.2034,0.5,0.25,0.00001,0.00002,0.00003\n"), "sZ") == [
        ("P1", 0.03)
    ]


def test_sigmas_that_are_all_zero_are_no_sigmas():
    points = read("Name,X [mm],Y [mm],Z [mm],sX,sY,sZ\nP1,1.2034,0.5,0.25,0,0,0\n")
    assert rows(points, "sX") == [("P1", None)]
    assert "all are 0" in said(points)


CAM = (
    "CAM2 export\nUnits:,Inches\n"
    "Label,Nominal X,Nominal Y,Nominal Z,Actual X,Actual Y,Actual Z,Deviation X,Deviation Y,Deviation Z,"
    "Date,Time,Probe Radius\n"
    "P1,1.0,2.0,3.0,1.0012,2.002,3.003,0.0012,0.002,0.003,2026-11-21,10:02:11,0.75\n"
)


def test_of_nominal_actual_and_deviation_the_actual_position_is_taken_with_its_time():
    points = read(CAM)
    assert rows(points, "X", "Y", "Z", "time", "sX") == [
        ("P1", 25.43048, 50.8508, 76.2762, "2026-11-21 10:02:11", None)
    ]
    assert "positions in inch, as line 2 says" in said(points)
    assert "columns not taken: Nominal X" in said(points)


def test_offsets_of_the_target_are_named_and_not_applied():
    assert "Probe Radius not applied" in said(read(CAM))
    assert rows(read(CAM), "X") == rows(read(CAM.replace(",0.75", ",19.05")), "X")


GROUPS = "A::Near::P1 1203.451 -311.021 982.11\nA::Near::P2 1412.77 45.18 601.53\nA::Far::P2 3412.97 45.18 601.53\n"


def test_one_name_in_two_groups_needs_the_group():
    with pytest.raises(InputError, match="P2 of group A::Far is on line 2 too") as refused:
        read(GROUPS, unit="mm")
    assert "--group NAME: A::Near, A::Far" in refused.value.problems[0].cure
    assert rows(read(GROUPS, unit="mm", group="Far"), "X") == [("P2", 3412.97)]
    assert rows(read(GROUPS, unit="mm", group="A::Near"), "X") == [("P1", 1203.451), ("P2", 1412.77)]
    with pytest.raises(InputError, match="no group 'Middle'"):
        read(GROUPS, unit="mm", group="Middle")


def test_collection_group_and_name_without_headings_are_the_columns_before_the_numbers():
    points = read("A Main P1 1203.451 -311.021 982.11\nA Main P2 1412.77 45.18 601.53\n", unit="mm")
    assert rows(points, "X") == [("P1", 1203.451), ("P2", 1412.77)]
    assert "A::Main" in said(points)
    numbered = read("A, Main, 1, 1203.451, -311.021, 982.11\nA, Main, 2, 1412.77, 45.18, 601.53\n", unit="mm")
    assert rows(numbered, "X") == [("1", 1203.451), ("2", 1412.77)]


@pytest.mark.parametrize("word", ["Cylindrical", "Spherical", "Polar"])
def test_coordinates_that_are_not_cartesian_are_refused(word):
    text = SA.replace("Cartesian", f"Coordinates: {word}")
    with pytest.raises(InputError, match="may not be Cartesian"):
        read(text)


def test_a_unit_that_is_not_known_is_refused_whatever_the_spread():
    with pytest.raises(InputError, match="the unit is not known: 'Cartesian, units: Feet'"):
        read(SA.replace("Millimeters", "Feet"))


@pytest.mark.parametrize("words", ["Units: mm, degrees", "Einheiten in mm", "Length unit: Millimetres", 'unit="mm"'])
def test_a_unit_in_the_preface_is_read_in_many_words(words):
    assert "positions in mm, as line 1 says" in said(read(f"{words}\nName;X;Y;Z\nP1;1,5;2;3\n"))


def test_comments_on_spherical_reflectors_are_no_statement_on_the_coordinates():
    assert rows(read("// 1.5 inch spherical reflector\n" + SA), "X")[0] == ("P1", 1203.451234)


def test_a_unit_in_the_preface_against_the_users_is_refused():
    with pytest.raises(InputError, match="line 3 says mm, --unit says m"):
        read(SA, unit="m")


def test_uncertainties_without_headings_are_not_guessed():
    with pytest.raises(InputError, match="a name and 6 numbers: which is which is not certain"):
        read(SA_HEADER + "P1, 1203.451, -311.021, 982.11, 0.01, 0.012, 0.02\n")


ORIENTED = "Frame,X [mm],Y [mm],Z [mm],Rx,Ry,Rz\nF1,1000.5,2,3,10,20,30\n"


def test_rx_ry_rz_are_taken_in_the_order_that_the_user_says():
    assert "RX, RY, RZ not taken (--orientation" in said(read(ORIENTED, columns={"name": "Frame"}))
    fixed = read(ORIENTED, columns={"name": "Frame"}, orientation="fixed-xyz")
    assert rows(fixed, "A", "B", "C", "RX") == [("F1", 30, 20, 10, None)]
    moving = read(ORIENTED, columns={"name": "Frame"}, orientation="euler-xyz").points[0]
    wanted = about("x", 10) @ about("y", 20) @ about("z", 30)
    np.testing.assert_allclose(rotation_from_abc([moving.values[name] for name in "ABC"]), wanted, atol=1e-9)


def about(axis, degrees):
    """The turn about one axis, written out."""
    sine, cosine = np.sin(np.deg2rad(degrees)), np.cos(np.deg2rad(degrees))
    place = "xyz".index(axis)
    turn = np.array([[1, 0, 0], [0, cosine, -sine], [0, sine, cosine]])
    return np.roll(turn, (place, place), (0, 1))


def test_a_rotation_vector_in_degrees_or_radians_is_the_same_orientation():
    heading = "Name,X [mm],Y [mm],Z [mm],Rx [{0}],Ry [{0}],Rz [{0}]\n"
    degrees = read(heading.format("deg") + "F1,1000.5,2,3,0,0,90\n", orientation="rotation-vector")
    radians = read(heading.format("rad") + f"F1,1000.5,2,3,0,0,{np.pi / 2}\n", orientation="rotation-vector")
    assert rows(degrees, *"ABC") == rows(radians, *"ABC") == [("F1", 90, 0, 0)]


def test_a_b_c_in_radians_become_degrees():
    text = f"Name,X [mm],Y [mm],Z [mm],A [rad],B [rad],C [rad]\nF1,1000.5,2,3,{np.pi / 2},0,0\n"
    assert rows(read(text, orientation="abc"), *"ABC") == [("F1", 90, 0, 0)]


def test_a_quaternion_under_other_headings_is_named_by_the_user():
    text = "Name,X [mm],Y [mm],Z [mm],q0,q1,q2,q3\nF1,1000.5,2,3,1,0,0,0\n"
    names = dict(zip(("QW", "QX", "QY", "QZ"), ("q0", "q1", "q2", "q3"), strict=True))
    assert rows(read(text, orientation="quaternion", columns=names), "QW", "QZ") == [("F1", 1, 0)]
