"""Cells that say what a row is, under which conditions, and how sure: taken, or named with the reason."""

import math

import numpy as np
import pytest

from cellctl.calibration import MeasuredRegion, PoseRows, PositionRows, SocketRows, TouchRows
from cellctl.files import InputError
from cellctl.formats import DataSet, RobotFile, measurements
from cellctl.formats.measurements import ModelTerms, Spacing
from cellctl.formats.model import JointRegion, ModelFile
from tests.helpers.arms import kr5_model

ROBOT = RobotFile.model_validate(
    {
        "name": "two joints",
        "convention": "mdh-hayati",
        "links": [{"d": 100.0, "alpha": 90.0}, {"a": 300.0}],
        "joints": [
            {"min": -90.0, "max": 90.0, "max_speed": 100.0},
            {"sign": -1, "min": -90.0, "max": 90.0, "max_speed": 100.0},
        ],
        "repeatability": 0.03,
    }
)


def measured(text, **options):
    return measurements(ROBOT, DataSet.parse(text, "data.csv"), model="geometry", **options)


def reasons(text, **options):
    return {row.line: row.reason for row in measured(text, **options).rejected}


def test_each_rows_filled_cells_say_what_it_is_and_lines_follow_the_order_of_the_task():
    head = "A1,A2,X,Y,Z,A,B,C,sphere,radius,socket,anchor,distance"
    rows = [
        "1,2,3,4,5,,,,,,,,",
        "1,2,3,4,5,6,7,8,,,,,",
        "1,2,,,,,,,S,30,,,",
        "1,2,,,,,,,,,P,,",
        "1,2,,,,,,,,,,bar,250",
        "3,4,,,,,,,S,30,,,",
        "3,4,,,,,,,,,P,,",
        "3,4,,,,,,,,,,bar,251",
    ]
    found = measured("\n".join([head, *rows]))
    assert [type(block) for block in found.task.rows.blocks] == [
        TouchRows,
        SocketRows,
        TouchRows,
        PoseRows,
        PositionRows,
    ]
    assert found.lines == (4, 7, 5, 8, 6, 9, 3, 2)
    assert found.kinds == (*("sphere",) * 2, *("socket",) * 2, *("distance",) * 2, "pose", "position")
    assert found.task.points == ("P", "S", "bar")
    assert [block.reach.tolist() for block in found.task.rows.blocks if isinstance(block, TouchRows)] == [
        [30.0, 30.0],
        [250.0, 251.0],
    ]


def test_conditions_reach_the_estimator_as_the_model_counts_them():
    text = "A1,A2,X,Y,Z,temperature,payload,D1,D2\n1,2,3,4,5,24,5,1,1\n1,2,3,4,5,,,-1,\n1,2,3,4,5,26,0,0,-1\n"
    at = measured(text).task.rows.only.postures
    np.testing.assert_allclose(at.delta_t, [4.0, 5.0, 6.0])
    np.testing.assert_allclose(at.payload, [5.0, 0.0, 0.0])
    np.testing.assert_allclose(at.approach, [[1, -1], [-1, 0], [0, 1]])


def test_a_condition_whose_column_is_missing_is_not_known():
    at = measured("A1,A2,X,Y,Z\n1,2,3,4,5\n").task.rows.only.postures
    assert (at.delta_t, at.payload, at.approach) == (None, None, None)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("A1,A2,X,Y,Z,payload\n1,2,3,4,5,1\n1,2,3,4,5,-1\n", "payload is -1"),
        ("A1,A2,X,Y,Z,temperature\n1,2,3,4,5,20\n1,2,3,4,5,warm\n", "temperature 'warm' is not a number"),
        ("A1,A2,X,Y,Z,D1\n1,2,3,4,5,1\n1,2,3,4,5,0.5\n", "D1 is 0.5"),
        ("A1,A2,X,Y,Z,session\n1,2,3,4,5,a\n1,2,3,4,5,\n", "session is missing"),
        ("A1,A2,anchor,distance\n1,2,bar,250\n1,2,bar,0\n", "distance is 0"),
        ("A1,A2,anchor,distance\n1,2,bar,250\n1,2,,250\n", "anchor is missing"),
        ("A1,A2,socket\n1,2,P\n1,2,\n", "socket is missing"),
        ("A1,A2,X,Y,Z,sX\n1,2,3,4,5,1\n1,2,3,4,5,0\n", "above 0"),
        ("A1,A2,X,Y,Z,A,B,C,sR\n1,2,3,4,5,6,7,8,1\n1,2,3,4,5,6,7,8,-1\n", "sR is -1"),
    ],
)
def test_a_cell_that_says_nothing_possible_is_named(text, words):
    assert words in reasons(text)[3]


def test_own_sigmas_of_orientation_and_distance_are_taken():
    pose = measured("A1,A2,X,Y,Z,A,B,C,sR\n1,2,3,4,5,6,7,8,0.1\n").task.rows.only
    np.testing.assert_allclose(pose.sigma[0, 3:], math.radians(0.1))
    bar = measured("A1,A2,anchor,distance,sD\n1,2,bar,250,0.007\n1,2,bar,250,\n").task.rows.only
    np.testing.assert_allclose(bar.sigma[:, 0], [0.007, 0.03 / math.sqrt(3)])


def test_a_base_of_its_own_is_only_a_sessions_that_an_instrument_measured():
    sockets = measured("A1,A2,socket,session\n1,2,P,a\n1,2,P,b\n")
    assert len(sockets.task.sessions) == 1
    assert sockets.task.points == ("P@a", "P@b")
    positions = measured("A1,A2,X,Y,Z,session\n1,2,3,4,5,b\n1,2,3,4,5,a\n")
    assert [(session.name, session.own) for session in positions.task.sessions] == [("b", {"base"}), ("a", {"base"})]


@pytest.mark.parametrize("words", ["A,B=50±0.01", " A , B = 50 +- 0.01 "])
def test_a_spacing_may_be_typed_with_either_sign(words):
    assert Spacing.parse(words) == Spacing(("A", "B"), 50.0, 0.01)


@pytest.mark.parametrize(
    "words", ["", "A,B=50", "A=50±1", "A,B=-50±1", "A,B=50±0", "A,A=50±1", "A,B=5.0.1±1", "A,B,C=5±1"]
)
def test_a_spacing_that_is_none_is_refused(words):
    with pytest.raises(InputError, match="--spacing"):
        Spacing.parse(words)


def test_terms_of_a_model_may_come_in_any_order():
    assert ModelTerms.parse("growth+compliance+geometry") == ModelTerms.parse("geometry+compliance+growth")
    assert ModelTerms.parse("geometry").groups() is None
    assert ModelTerms.parse("zeros+backlash").groups() == {"zeros", "backlash", "tool"}
    assert ModelTerms.parse("registration").groups() == frozenset()


def test_a_model_file_without_postures_doubts_by_the_square_of_the_distance_in_halves_of_the_measured_span():
    region = JointRegion(min=[-40.0, 10.0], max=[40.0, 10.0])
    readings = np.array([[0.0, 10.0], [41.0, 10.0], [60.0, 10.0], [200.0, 10.0], [60.0, 15.0]])
    joints = ROBOT.joint_map()
    sigma = MeasuredRegion(*region.bounds(joints), 2.0, region.coverage(joints)).sigma(joints.model(readings))
    np.testing.assert_allclose(sigma, [0.0, 0.0, 0.5, 2.0, 2.0 * math.hypot(0.25, 0.25)])
    assert region.inside(readings, joints).tolist() == [True, True, False, False, False]


def test_the_factor_for_a_model_error_that_touches_do_not_show_is_in_the_file_and_in_sigma():
    plain = kr5_model()
    scaled = ModelFile.model_validate({**plain.model_dump(), "model_error_scale": 1.5, "degrees_of_freedom": 8.0})
    readings = np.array([[0.0, -70.0, 80.0, 0.0, 60.0, 0.0]])
    np.testing.assert_allclose(scaled.sigma(readings), 1.5 * plain.sigma(readings))
    assert scaled.radius_95 > plain.radius_95 == pytest.approx(1.614, abs=1e-3)
    for name in ("model_error_scale", "degrees_of_freedom"):
        assert name in scaled.text()
        assert name not in plain.text()
