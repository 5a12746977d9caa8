"""Numbers, stand-offs and words of the report, against closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellctl.report.figures import (
    HARMLESS,
    OTHERWISE,
    fixed,
    mean_with_uncertainty,
    percent,
    plain,
    reasons,
    significant,
    with_sigma,
)
from procedures.reports.sphere.standoffs import StandOffErrors
from procedures.steps.sphere.rows import StandOffRow


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


def test_what_is_unobservable_is_listed_under_its_reason_with_its_meaning():
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


def test_an_older_fit_knows_the_combinations_and_no_reason():
    (only,) = reasons({"unobservable": ["θ1 with centre of S1", "a2 with d4"]})
    assert (only.meaning, only.phrases) == (OTHERWISE, ["θ1 with centre of S1", "a2 with d4"])
    assert reasons({"unobservable": []}) == reasons({}) == []


def test_stand_offs_are_told_apart_by_run_and_compared_with_their_predicted_sigma():
    def row(number, run, error, sigma):
        joints = dict.fromkeys(("resting", "nominal", "commanded", "at_target", "at_contact"), (0.0,) * 6)
        counts = dict.fromkeys(
            ("time_ns", "time_sigma_ns", "tick", "bounces", "stop_cycles", "late", "lost", "skipped"), 0
        )
        of = {"number": number, "sphere": "P1", "run": run, "row": None, "attempt": 1, "normal": (0.0, 0.0, 1.0)}
        return StandOffRow(**joints, **counts, **of, travel_mm=10.0, error_mm=error, expected_mm=0.0, sigma_mm=sigma)

    rows = [row(1, "before", 1.0, 0.1), row(1, "after", 0.3, 0.4), row(2, "after", -0.4, 0.3)]
    after = StandOffErrors.of(rows, "after")
    assert after.numbers.tolist() == [1.0, 2.0]
    assert after.found_sigma == pytest.approx(math.sqrt((0.09 + 0.16) / 2))
    assert after.predicted_sigma == pytest.approx(math.sqrt((0.16 + 0.09) / 2))
    assert after.within_two_sigma == 1.0
    assert math.isnan(StandOffErrors.of([], "after").found_sigma)
    assert StandOffErrors.of([], "after").within_two_sigma is None
