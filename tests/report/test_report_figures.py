"""Numbers, volume and words of the report, against closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from kr5_model import kr5_model

from cellctl.report.numbers import fixed, percent, plain, significant, with_sigma
from cellctl.report.standoff import StandOff
from cellctl.report.volume import volume_sigma, without_rigid_motion
from cellctl.report.words import HARMLESS, OTHERWISE, harmless, mean_with_uncertainty, reasons


@pytest.mark.parametrize(
    ("value", "sigma", "text"),
    [
        (-1.5713, 0.0370, "−1.571 ± 0.037"),
        (1.7452, 0.1786, "1.75 ± 0.18"),
        (0.013325, 0.00276, "0.0133 ± 0.0028"),
        (5.0, 0.0996, "5.00 ± 0.10"),
        (1234.5, 87.0, "1234 ± 87"),
        (-0.00001, 0.05, "0.000 ± 0.050"),
        (1.25, 0.0, "1.250"),
    ],
)
def test_a_sigma_has_two_digits_and_its_value_as_many_decimals(value, sigma, text):
    assert with_sigma(value, sigma) == text


@given(st.floats(min_value=1e-6, max_value=1e5))
def test_two_significant_digits_are_never_off_by_more_than_half_a_unit(value):
    assert math.isclose(float(significant(value)), value, rel_tol=0.0505, abs_tol=0.5)


def test_what_is_no_number_is_a_dash_and_a_share_is_never_rounded_to_none_or_all():
    assert fixed(None) == fixed(math.nan) == significant(math.inf) == percent(None) == "–"
    assert (percent(0.001), percent(0.999), percent(0.0), percent(1.0)) == ("< 1 %", "> 99 %", "0 %", "100 %")
    assert plain({"a_b": 5.0, "c": [True, None]}) == "a b 5, c yes, –"


def test_the_uncertainty_of_a_mean_is_s_over_root_n():
    errors = np.array([0.1, 0.2, 0.4, 0.7])
    text = mean_with_uncertainty(errors.mean(), np.sqrt(np.mean(errors**2)), 4)
    assert text == with_sigma(errors.mean(), errors.std(ddof=1) / 2.0)


def test_a_rigid_motion_is_removed_whole_and_a_growth_is_kept():
    random = np.random.default_rng(1)
    points = random.uniform(-500.0, 500.0, (50, 3)) + np.array([1000.0, 0.0, 400.0])
    turn = np.cross([0.001, -0.002, 0.0005], points) + np.array([1.0, 2.0, 3.0])
    growth = 0.001 * (points - points.mean(axis=0))
    left = without_rigid_motion(points, np.stack([turn, turn + growth], axis=-1))
    assert np.abs(left[..., 0]).max() < 1e-9
    assert left[..., 1] == pytest.approx(growth, abs=1e-9)


def test_points_on_a_line_have_their_rigid_motions_removed_too():
    points = np.linspace(0.0, 100.0, 10)[:, None] * np.array([[1.0, 1.0, 0.0]])
    moves = np.cross([0.0, 0.0, 0.01], points)[..., None]
    assert np.abs(without_rigid_motion(points, moves)).max() < 1e-9


def test_an_unknown_heading_is_all_of_the_raw_sigma_and_none_of_the_relative_one():
    model = kr5_model()
    names = [parameter.name for parameter in model.parameters]
    covariance = np.zeros((len(names), len(names)))
    covariance[names.index("theta1"), names.index("theta1")] = 0.001**2
    found = volume_sigma(model.model_copy(update={"covariance": covariance.tolist()}))
    assert found is not None
    assert found.relative_max < 1e-6
    farthest = np.hypot(950.0 + 200.0, 350.0 + 200.0) * 0.001  # the box about S1, seen from the first axis
    assert 0.3 < found.raw_max <= farthest


def test_an_unknown_length_is_seen_in_the_relative_sigma():
    model = kr5_model()
    names = [parameter.name for parameter in model.parameters]
    covariance = np.zeros((len(names), len(names)))
    covariance[names.index("a2"), names.index("a2")] = 0.5**2
    found = volume_sigma(model.model_copy(update={"covariance": covariance.tolist()}))
    assert found is not None
    assert found.raw_rms == pytest.approx(0.5)  # a slide along one axis moves every point by as much
    assert 0.01 < found.relative_rms < 0.5


def test_what_was_not_seen_stands_under_its_cause_and_does_harm_but_for_base_and_tool():
    bolted = {"cause": "no row can tell", "harmless": True, "words": ["θ1 with centre of S1"]}
    still = {"cause": "joint 3 never moves in these rows", "harmless": False, "words": ["θ2 with α3"]}
    away = {"cause": "no row of the fit belongs to session b", "harmless": False, "words": []}
    first, second, third = reasons({"unseen": [still, bolted, away], "unobservable": ["θ2 with α3"]})
    assert (first.cause, first.meaning, first.phrases) == (
        "Joint 3 never moves in these rows.",
        OTHERWISE,
        ["θ2 with α3"],
    )
    assert (second.meaning, third.meaning) == (HARMLESS, "")
    assert harmless({"unseen": [bolted, away]})
    assert not harmless({"unseen": [still, bolted]})


def test_figures_from_before_causes_were_known_do_harm_for_all_one_knows():
    (only,) = reasons({"unobservable": ["θ1 with centre of S1", "a2 with d4"]})
    assert (only.meaning, only.phrases) == (OTHERWISE, ["θ1 with centre of S1", "a2 with d4"])
    assert reasons({"unobservable": []}) == reasons({}) == []
    assert not harmless({"unobservable": ["a2 with d4"]})


def test_stand_off_rows_of_another_run_or_without_an_error_do_not_count():
    rows = [
        {"number": 1, "run": "before", "error_mm": 1.0},
        {"number": 1, "run": "after", "error_mm": 0.3, "sigma_mm": 0.4},
        {"number": 2, "run": "after", "error_mm": -0.4, "sigma_mm": None},
        {"number": 3, "run": "after", "error_mm": None},
    ]
    after = StandOff.of(rows, "after")
    assert after.numbers.tolist() == [1.0, 2.0]
    assert after.found_sigma == pytest.approx(math.sqrt((0.09 + 0.16) / 2))
    assert after.predicted_sigma == pytest.approx(0.4)
    assert math.isnan(StandOff.of([], "after").found_sigma)
