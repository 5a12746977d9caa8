"""What baselines and network do with samples that are few, repeated, constant, or wrong."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cellctl.error_maps.inverse_distance import GridInverseDistance, tuned_grid
from cellctl.error_maps.perceptron import Perceptron, tuned_perceptron
from cellctl.error_maps.samples import LEAST, UnusableSamples, grouped_folds

METHODS = [Perceptron(8, 1e-2), GridInverseDistance(0.2, 2.0)]


def error_at(places):
    """A smooth error of some tenths."""
    x, y, z = places.T
    return 0.3 * np.stack([np.sin(2 * x), np.cos(x + y), y * z], axis=1)


@pytest.fixture
def places(rng):
    return rng.uniform(-1.0, 1.0, (120, 3))


@pytest.fixture
def rng():
    return np.random.default_rng(7)


@pytest.mark.parametrize("method", METHODS)
def test_ten_points_give_a_map_within_the_range_of_their_errors(places, method):
    few = error_at(places[:10])
    found = method.fit(places[:10], few).errors(places)
    assert np.all(np.abs(found) < 3 * np.abs(few).max())


@pytest.mark.parametrize("method", METHODS)
def test_nine_points_are_refused_with_the_number_that_is_needed(places, method):
    with pytest.raises(UnusableSamples, match=rf"9 samples.*at least {LEAST}"):
        method.fit(places[:9], error_at(places[:9]))


def test_ten_points_can_be_tuned(places):
    few, values = places[:10], error_at(places[:10])
    assert np.isfinite(tuned_grid(few).fit(few, values).errors(places)).all()
    assert np.isfinite(tuned_perceptron(hidden=[4], alphas=[0.1, 1.0]).fit(few, values).errors(places)).all()


@pytest.mark.parametrize("method", METHODS)
def test_constant_errors_are_predicted_exactly(places, method):
    same = np.tile([0.1, -0.2, 0.3], (len(places), 1))
    assert_allclose(method.fit(places, same).errors(places + 0.05), same, atol=1e-12)


@pytest.mark.parametrize("method", METHODS)
def test_one_error_component_may_be_constant(places, method):
    errors = error_at(places) * [1.0, 0.0, 1.0]
    assert_allclose(method.fit(places, errors).errors(places)[:, 1], 0.0, atol=1e-12)


@pytest.mark.parametrize("method", METHODS)
def test_a_joint_that_never_moves_changes_nothing_but_the_others_count(places, method):
    still = np.column_stack([places[:, 0], np.full(len(places), 0.7), places[:, 2]])
    errors = np.stack([np.sin(still[:, 0]), still[:, 2], still[:, 0] * still[:, 2]], axis=1)
    found = method.fit(still, errors).errors(still)
    assert np.sqrt(np.mean((found - errors) ** 2)) < 0.35 * errors.std()


def test_repeated_points_with_different_errors_count_with_their_mean(places, rng):
    twice, noise = np.concatenate([places, places]), rng.normal(0.0, 0.02, (120, 3))
    errors = np.concatenate([error_at(places) + noise, error_at(places) - noise])
    perceptron, grid = METHODS
    assert np.sqrt(np.mean((perceptron.fit(twice, errors).errors(places) - error_at(places)) ** 2)) < 0.01
    found, once = grid.fit(twice, errors).errors(places), grid.fit(places, error_at(places)).errors(places)
    assert_allclose(found, once, atol=1e-12)


def test_a_sample_at_a_grid_point_is_its_value_and_repeats_there_are_averaged(places):
    inside = np.abs(places)
    corner = np.zeros((2, 3))  # the samples' lowest corner is a grid point
    errors = np.concatenate([[[0.1, 0.0, 0.0], [0.3, 0.0, 0.0]], error_at(inside)])
    found = GridInverseDistance(0.5, 2.0).fit(np.concatenate([corner, inside]), errors).errors(np.zeros((1, 3)))
    assert_allclose(found, [[0.2, 0.0, 0.0]])


@pytest.mark.parametrize("method", METHODS)
def test_one_far_outlier_is_refused_with_its_number(places, method):
    errors = error_at(places)
    errors[16] += 25.0
    with pytest.raises(UnusableSamples, match=r"error of sample 17.*leave it out"):
        method.fit(places, errors)


def test_errors_that_are_at_one_of_two_values_are_no_outliers(places, rng):
    """As joint errors by friction in the motor currents: half of them are closer together than the scatter."""
    friction = np.where(np.arange(len(places)) % 20 < 11, 0.3, -0.3)[:, None] + rng.normal(0.0, 1e-3, (len(places), 1))
    assert np.isfinite(METHODS[1].fit(places, friction).errors(places)).all()


def test_inputs_that_move_one_joint_after_the_other_are_no_outliers(rng):
    turned = np.concatenate([np.outer(rng.uniform(-1.0, 1.0, 20), axis) for axis in np.eye(6)])
    errors = np.sin(turned @ rng.uniform(-1.0, 1.0, (6, 3)))
    assert np.isfinite(METHODS[0].fit(turned + rng.normal(0.0, 1e-5, turned.shape), errors).errors(turned)).all()


def test_one_far_outlier_among_ten_points_is_refused(places):
    errors = error_at(places[:10])
    errors[4, 1] -= 25.0
    with pytest.raises(UnusableSamples, match="component 2 of the error of sample 5"):
        METHODS[0].fit(places[:10], errors)


def test_a_place_in_other_units_is_refused_with_its_number(places):
    places[3] *= 57.3
    with pytest.raises(UnusableSamples, match="inputs of sample 4"):
        METHODS[0].fit(places, error_at(places))


@pytest.mark.parametrize(
    ("inputs", "errors", "words"),
    [
        (np.ones((20, 3)), np.zeros((20, 3)), "same inputs"),
        (np.ones((20, 3)), np.zeros((19, 3)), "one row for each sample"),
        (np.full((20, 3), np.nan), np.zeros((20, 3)), "sample 1 has a number that is not finite"),
    ],
)
def test_samples_that_fit_no_map_are_refused_with_the_reason(inputs, errors, words):
    with pytest.raises(UnusableSamples, match=words):
        METHODS[1].fit(inputs, errors)


def test_repeats_of_a_point_are_held_out_together(places):
    repeated = np.concatenate([places, places[:40]])
    for held in grouped_folds(repeated, 5, 0):
        assert np.array_equal(held[:40], held[120:])
    assert np.array_equal(np.sum(grouped_folds(repeated, 5, 0), axis=0), np.ones(160))
