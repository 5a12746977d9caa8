"""The field as an error map: its error, its σ, one posture the fast way, and rows that are not as they should be."""

import numpy as np
import pytest

from cellctl.error_maps.field import AnisotropicField
from cellctl.error_maps.kriging import Kriging, ParticleFilter
from cellctl.error_maps.samples import UnusableSamples


def mean_error(made, q, errors):
    return float(np.linalg.norm(made.errors(q) - errors, axis=1).mean())


def test_it_predicts_no_worse_than_published_kriging_whose_filter_has_more_rows(measured):
    q, errors = measured(80, 31)
    there, actual = measured(80, 32)
    search = ParticleFilter(np.ones((3, 6)), particles=30, rounds=6)
    weights = search.weights(q, errors, *measured(40, 33))
    found = AnisotropicField().fit(q, errors)
    assert mean_error(found, there, actual) <= mean_error(Kriging(weights).fit(q, errors), there, actual)


def test_95_of_100_errors_of_such_a_process_lie_within_their_stated_sigma():
    rng = np.random.default_rng(34)
    q = rng.uniform(-1.0, 1.0, (620, 4))
    scaled = q / [0.7, 1.5, 4.0, 10.0]
    square = 0.2**2 * np.exp(-0.5 * ((scaled[:, None] - scaled) ** 2).sum(axis=-1)) + 0.01**2 * np.eye(620)
    errors = np.linalg.cholesky(square) @ rng.standard_normal((620, 3))
    made = AnisotropicField().fit(q[:120], errors[:120])
    sigma = np.hypot(made.sigma(q[120:]), [each.nugget for each in made.processes])
    inside = np.abs(made.errors(q[120:]) - errors[120:]) < 1.96 * sigma
    assert 0.92 < inside.mean() < 0.97


def test_far_from_the_rows_sigma_is_the_amplitude_and_the_error_the_mean(measured):
    q, errors = measured(60, 36)
    made = AnisotropicField().fit(q, errors)
    far = np.full((1, 6), 1e3)
    np.testing.assert_allclose(made.errors(far)[0], errors.mean(axis=0), atol=1e-9)
    np.testing.assert_allclose(made.sigma(far)[0], [each.amplitude for each in made.processes])


def test_one_posture_the_fast_way_is_the_same_error(measured):
    made, there = AnisotropicField().fit(*measured(60, 37)), measured(20, 38)[0]
    np.testing.assert_allclose([made.error(q) for q in there], made.errors(there), atol=1e-7)


def test_repeated_postures_ten_rows_constant_errors_and_a_still_joint_have_sound_maps(measured):
    there, actual = measured(80, 40)
    q, errors = measured(60, 41)
    once, twice = (AnisotropicField().fit(np.tile(q, (k, 1)), np.tile(errors, (k, 1))) for k in (1, 2))
    assert mean_error(twice, there, actual) < 1.3 * mean_error(once, there, actual)

    few = AnisotropicField().fit(*measured(10, 42))
    mean = np.linalg.norm(actual - measured(10, 42)[1].mean(axis=0), axis=1).mean()
    assert mean_error(few, there, actual) < 1.1 * mean

    constant = AnisotropicField().fit(q, np.tile([0.3, -0.2, 0.1], (60, 1)))
    np.testing.assert_allclose(constant.errors(there), np.tile([0.3, -0.2, 0.1], (80, 1)), atol=1e-9)
    assert constant.sigma(there).max() < 1e-5

    q[:, 2] = 0.4
    still, elsewhere = AnisotropicField().fit(q, errors), q.copy()
    elsewhere[:, 2] = 1.0
    np.testing.assert_array_equal(still.errors(q), still.errors(elsewhere))


def test_a_far_outlier_is_refused_with_its_number(measured):
    q, errors = measured(40, 43)
    errors[7, 2] -= 200.0
    with pytest.raises(UnusableSamples, match=r"component 3 of the error of sample 8: .*; measure that sample again"):
        AnisotropicField().fit(q, errors)
