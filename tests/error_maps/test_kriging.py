"""Kriging as published: the paper's equations, and rows that are not as they should be."""

import itertools

import numpy as np
import pytest

from cellctl.error_maps.kriging import INITIAL_WEIGHTS, Kriging
from cellctl.error_maps.samples import UnusableSamples
from cellctl.error_maps.semivariogram import EmpiricalSemivariogram, GaussianSemivariogram


def mean_error(made, q, errors):
    return float(np.linalg.norm(made.errors(q) - errors, axis=1).mean())


def test_the_semivariance_of_each_interval_is_equation_13_pair_by_pair(measured):
    q, errors = measured(40, 1)
    q = (q - q.mean(axis=0)) / q.std(axis=0)
    e = (errors[:, 0] - errors[:, 0].mean()) / errors[:, 0].std()
    pairs = [(np.linalg.norm(q[i] - q[j]), e[i] - e[j]) for i in range(40) for j in range(i)]
    edges = np.linspace(min(h for h, _ in pairs), max(h for h, _ in pairs), 21)
    expected = []
    for low, high in itertools.pairwise(edges):
        inside = [d for h, d in pairs if low <= h < high or h == high == edges[-1]]
        if inside:
            expected.append(sum(d * d for d in inside) / (2 * len(inside)))
    found = EmpiricalSemivariogram.of(np.array([h for h, _ in pairs]), np.array([d for _, d in pairs]))
    np.testing.assert_allclose(found.gamma, expected, rtol=1e-12)
    assert found.pairs.sum() == len(pairs)


@pytest.mark.parametrize(("nugget", "sill", "reach"), [(0.1, 1.0, 3.0), (0.0, 1.3, 5.0), (0.3, 0.4, 1.5)])
def test_a_semivariogram_of_gaussian_shape_is_found_again(nugget, sill, reach):
    distances = np.linspace(0.2, 6.0, 20)
    gamma = GaussianSemivariogram(nugget, sill, reach).at(distances)
    found = GaussianSemivariogram.fitted(EmpiricalSemivariogram(distances, gamma, np.ones(20), 6.1))
    assert (found.nugget, found.sill, found.range) == pytest.approx((nugget, sill, reach), rel=0.01, abs=0.002)


def test_no_other_semivariogram_has_a_smaller_sum_of_squares(measured):
    from scipy.optimize import least_squares

    q, errors = measured(100, 2)
    axis = Kriging(INITIAL_WEIGHTS).fit(q, errors).axes[0]
    h, gamma = axis.empirical.distances, axis.empirical.gamma

    def away(x):
        return GaussianSemivariogram(*x).at(h) - gamma

    other = least_squares(away, [0.1, 1.0, 3.0], bounds=([0.0, 0.0, 0.1], [10.0, 50.0, 3.0 * axis.empirical.greatest]))
    assert np.sum((axis.semivariogram.at(h) - gamma) ** 2) <= 2.0 * other.cost * 1.001


def test_a_prediction_is_equations_15_to_19_written_out(measured):
    q, errors = measured(50, 3)
    made = Kriging(INITIAL_WEIGHTS, regularisation=0.01).fit(q, errors)
    target = measured(1, 4)[0][0]
    for axis in range(3):
        reach, weights = made.axes[axis].semivariogram.range, INITIAL_WEIGHTS[axis]
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
