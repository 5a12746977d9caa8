"""KRL text that is written: it reads back as the same numbers, and no controller refuses its names and lines."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellctl.krl import KrlFile
from cellctl.krl.writing import aggregate_text, data_list, declaration_text, number_text, program

VALUES = st.floats(-1e5, 1e5)


@pytest.mark.parametrize(
    ("value", "text"), [(0.0, "0.0"), (-1e-9, "0.0"), (-90, "-90.0"), (1 / 3, "0.333333"), (1234.5, "1234.5")]
)
def test_a_number_has_a_decimal_point_and_no_exponent(value, text):
    assert number_text(value) == text


def test_status_and_turn_are_whole():
    assert aggregate_text({"X": 1, "S": 2.0, "T": 35}) == "{X 1.0,S 2,T 35}"
    with pytest.raises(ValueError, match=r"T 35\.5 is not whole"):
        aggregate_text({"T": 35.5})
    with pytest.raises(ValueError, match="no number of KRL"):
        number_text(math.nan)


@given(st.lists(VALUES, min_size=6, max_size=6))
def test_a_declared_point_reads_back_to_six_decimals(values):
    text = data_list("P", [declaration_text("E6AXIS", "XP1", {f"A{n}": v for n, v in enumerate(values, 1)})])
    point = KrlFile.parse(text.encode("ascii"), "p.dat").point("XP1")
    assert list(point.values.values()) == pytest.approx(values, abs=5.1e-7)


def test_rounded_joints_move_the_tcp_by_less_than_a_micrometre():
    reach_mm = 3000.0
    rounded = float(number_text(12.3456789123)) - 12.3456789123
    assert reach_mm * math.radians(abs(rounded)) < 0.001
    single = np.float32(179.999999)  # what a REAL of the controller keeps
    assert reach_mm * math.radians(abs(float(single) - 179.999999)) < 0.001


@pytest.mark.parametrize("name", ["1P", "A B", "X" * 25, "Höhe", ""])
def test_names_that_a_controller_refuses_are_refused(name):
    with pytest.raises(ValueError, match="no name of KRL"):
        declaration_text("E6POS", name)


def test_comments_become_ascii_and_one_line():
    text = program(["DEF P( )\nEND"], ["Prüfling\nPTP XP1", "x" * 1000])
    assert "; Pr?fling PTP XP1\n" in text
    with pytest.raises(ValueError, match="may refuse this line"):
        program(["DEF P( )\nXP1=" + "1+" * 300 + "1\nEND"])
