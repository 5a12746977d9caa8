"""Kriging as published: the paper's equations, and rows that are not as they should be."""

import numpy as np
import pytest

from cellctl.error_maps.kriging import INITIAL_WEIGHTS, Kriging
from cellctl.error_maps.samples import UnusableSamples


def mean_error(made, q, errors):
    return float(np.linalg.norm(made.errors(q) - errors, axis=1).mean())


def test_a_prediction_is_equations_15_to_19_written_out(measured):
    q, errors = measured(50, 3)
    made = Kriging(INITIAL_WEIGHTS, regularisation=0.01).fit(q, errors)
    target = measured(1, 4)[0][0]
    for axis in range(3):
        reach, weights = made.axes[axis].range, INITIAL_WEIGHTS[axis]
        own = (q - q.mean(axis=0)) / q.std(axis=0) * weights
        there = (target - q.mean(axis=0)) / q.std(axis=0) * weights
        big = np.array([[np.exp(-3.0 * np.sum((a - b) ** 2) / reach**2) for b in own] for a in own])
        small = np.array([np.exp(-3.0 * np.sum((there - b) ** 2) / reach**2) for b in own])
        share = np.linalg.solve(big + 0.01 * np.eye(50), small)
        e = errors[:, axis]
        expected = e.mean() + e.std() * share @ ((e - e.mean()) / e.std())
        assert made.errors(target[None])[0, axis] == pytest.approx(expected, abs=1e-9)


def test_the_map_predicts_other_postures_far_better_than_their_mean(measured):
    q, errors = measured(160, 5)
    there, actual = measured(80, 6)
    mean = float(np.linalg.norm(actual - errors.mean(axis=0), axis=1).mean())
    assert mean_error(Kriging().fit(q, errors), there, actual) < 0.15 * mean


def test_repeated_postures_change_the_map_little(measured):
    q, errors = measured(60, 7)
    there, actual = measured(80, 8)
    twice = Kriging().fit(np.vstack([q, q]), np.vstack([errors, errors]))
    assert mean_error(twice, there, actual) < 1.2 * mean_error(Kriging().fit(q, errors), there, actual)


def test_constant_errors_are_predicted_as_they_are(measured):
    q, errors = measured(30, 9)
    errors[:] = (0.3, -0.2, 0.1)
    np.testing.assert_allclose(Kriging().fit(q, errors).errors(measured(5, 10)[0]), errors[:5], atol=1e-12)


def test_errors_that_are_not_alike_at_near_postures_are_predicted_as_their_mean(measured):
    """Postures are at two places only: no semivariogram can be fitted."""
    places, errors = measured(30, 16)
    q = places[np.arange(30) % 2]
    found = Kriging().fit(q, errors).errors(measured(5, 17)[0])
    np.testing.assert_allclose(found, np.tile(errors.mean(axis=0), (5, 1)), atol=1e-12)


def test_ten_rows_are_better_than_their_mean(measured):
    q, errors = measured(10, 11)
    there, actual = measured(80, 12)
    mean = float(np.linalg.norm(actual - errors.mean(axis=0), axis=1).mean())
    assert mean_error(Kriging().fit(q, errors), there, actual) < mean


def test_a_joint_that_never_moved_has_no_influence(measured):
    q, errors = measured(60, 13)
    q[:, 3] = 0.2
    made, elsewhere = Kriging().fit(q, errors), q.copy()
    elsewhere[:, 3] = 0.7
    np.testing.assert_array_equal(made.errors(elsewhere), made.errors(q))
    assert np.isfinite(made.errors(q)).all()


def test_a_far_outlier_is_refused_with_its_number_and_the_cure(measured):
    q, errors = measured(60, 14)
    errors[16, 1] += 300.0
    with pytest.raises(UnusableSamples, match=r"component 2 of the error of sample 17: .*; measure that sample again"):
        Kriging().fit(q, errors)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda q, e: (q[:9], e[:9]), "9 samples: an error map needs at least 10"),
        (lambda q, e: (q[:1].repeat(20, axis=0), e), "all samples have the same inputs"),
        (lambda q, e: (q, e[:-1]), "one row for each sample"),
        (lambda q, e: (q, np.where(np.arange(60).reshape(20, 3) == 7, np.nan, e)), "sample 3 has a number"),
        (lambda q, e: (np.hstack([q, q[:, :1]]), e), r"joint weights \(3, 6\) for 7 joints"),
    ],
)
def test_rows_that_make_no_map_are_refused_with_the_cure(measured, spoil, message):
    q, errors = spoil(*measured(20, 15))
    with pytest.raises(ValueError, match=message):
        Kriging(INITIAL_WEIGHTS).fit(q, errors)
