"""Hyper-parameters of the field: closed-form gradients, and the values that made the rows."""

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from cellctl.calibration.residuals.joint_field import AxisProcess, LogNormal, Priors, likelihood

LENGTHS, AMPLITUDE, NUGGET = np.array([0.6, 1.5, 4.0]), 0.3, 0.02


def rows(count=120, seed=1):
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1.5, 1.5, (count, 3))
    square = AMPLITUDE**2 * np.exp(-0.5 * cdist(q / LENGTHS, q / LENGTHS, "sqeuclidean")) + NUGGET**2 * np.eye(count)
    return q, np.linalg.cholesky(square) @ rng.standard_normal(count)


@pytest.mark.parametrize("with_known", [False, True])
def test_every_derivative_is_the_central_difference(with_known):
    q, errors = rows()
    known = 0.05 * (q @ q.T) if with_known else None
    logs = np.log([0.8, 1.0, 2.0, 0.2, 0.03])
    for number, slope in enumerate(likelihood(logs, q, errors, known)[1]):
        step = 1e-5 * np.eye(5)[number]
        ends = [likelihood(logs + side * step, q, errors, known)[0] for side in (1.0, -1.0)]
        assert slope == pytest.approx((ends[0] - ends[1]) / 2e-5, rel=1e-5, abs=1e-4)


def test_the_likelihood_is_the_density_of_a_normal_distribution():
    from scipy.stats import multivariate_normal

    q, errors = rows(30)
    scaled = q / [0.8, 1.0, 2.0]
    square = 0.04 * np.exp(-0.5 * ((scaled[:, None] - scaled) ** 2).sum(axis=-1)) + 0.0009 * np.eye(30)
    found, _ = likelihood(np.log([0.8, 1.0, 2.0, 0.2, 0.03]), q, errors)
    assert found == pytest.approx(multivariate_normal(cov=square).logpdf(errors), abs=1e-6)


def test_the_values_that_made_the_rows_are_found():
    found = AxisProcess.fitted(*rows(300), Priors().of_errors(AMPLITUDE))
    np.testing.assert_allclose(found.lengths, LENGTHS, rtol=0.3)
    assert found.nugget == pytest.approx(NUGGET, rel=0.15)


def test_what_other_terms_may_explain_is_no_field():
    rng = np.random.default_rng(2)
    q = rng.uniform(-1.5, 1.5, (100, 3))
    errors = q @ [2.0, -1.0, 0.5] + 0.02 * rng.standard_normal(100)
    found = AxisProcess.fitted(q, errors, Priors().of_errors(0.1), 100.0 * q @ q.T)
    assert found.nugget == pytest.approx(0.02, rel=0.25)
    assert found.amplitude < 0.02 or found.lengths.min() > 2.0


def test_a_bound_holds_a_length():
    found = AxisProcess.fitted(*rows(), Priors(length=LogNormal(2.0, 1.0, 1.0, 3.0)).of_errors(AMPLITUDE))
    assert found.lengths.min() == pytest.approx(1.0)
    assert found.lengths.max() <= 3.0 + 1e-9
