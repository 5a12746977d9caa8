"""The particle filter for joint weights: its own test set decides, and the same seed gives the same weights."""

import dataclasses

import numpy as np
import pytest

from cellctl.error_maps.kriging import INITIAL_WEIGHTS, Kriging, ParticleFilter
from cellctl.error_maps.samples import UnusableSamples

SHORT = dataclasses.replace(ParticleFilter.published(), particles=30, rounds=6)


@pytest.fixture
def rows(measured):
    return (*measured(80, 21), *measured(40, 22))


def test_the_weights_found_predict_rows_of_a_third_set_better_than_the_first_ones(measured, rows):
    q, errors, _, _ = rows
    there, actual = measured(80, 23)

    def mean(weights):
        return np.linalg.norm(Kriging(weights).fit(q, errors).errors(there) - actual, axis=1).mean()

    assert mean(SHORT.weights(*rows)) < 0.8 * mean(INITIAL_WEIGHTS)


@pytest.mark.long
def test_the_same_seed_finds_the_same_weights_and_another_seed_others(rows):
    first = SHORT.weights(*rows)
    np.testing.assert_array_equal(first, SHORT.weights(*rows))
    assert not np.array_equal(first, dataclasses.replace(SHORT, seed=1).weights(*rows))


def test_no_weight_found_is_worse_on_the_test_set_than_the_first_ones(rows):
    q, errors, there, actual = rows
    found, first = (
        Kriging(weights).fit(q, errors).errors(there) for weights in (SHORT.weights(*rows), INITIAL_WEIGHTS)
    )
    assert (np.abs(found - actual).mean(axis=0) <= np.abs(first - actual).mean(axis=0) + 1e-12).all()


def test_a_test_set_with_an_outlier_is_refused(rows):
    q, errors, there, actual = rows
    actual = actual.copy()
    actual[3, 0] += 100.0
    with pytest.raises(UnusableSamples, match="component 1 of the error of sample 4"):
        SHORT.weights(q, errors, there, actual)
