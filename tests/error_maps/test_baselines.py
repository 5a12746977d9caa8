"""The baselines' accuracy on known functions, their tuning, and the same digits from the same seed."""

import builtins
import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from cellctl.error_maps.inverse_distance import GridInverseDistance, tuned_grid
from cellctl.error_maps.perceptron import LibraryMissing, Perceptron, tuned_perceptron
from cellctl.error_maps.samples import grouped_folds, held_out_rms


def error_at(places):
    x, y, z = places.T / 500.0
    return np.stack([np.sin(2 * x), np.cos(y + x), y * z], axis=1)


@pytest.fixture
def places():
    return np.random.default_rng(3).uniform(-500.0, 500.0, (160, 3))


@pytest.fixture
def others():
    return np.random.default_rng(4).uniform(-450.0, 450.0, (200, 3))


def rms(found, true):
    return float(np.sqrt(np.mean(np.sum((found - true) ** 2, axis=1))))


def test_a_perceptron_learns_a_smooth_error_from_160_points(places, others):
    learnt = Perceptron(16, 1e-2).fit(places, error_at(places))
    assert rms(learnt.errors(others), error_at(others)) < 0.02


def test_the_same_seed_gives_the_same_digits_and_another_seed_other_ones(places, others):
    one, same, other = (Perceptron(8, 1e-2, seed).fit(places, error_at(places)).errors(others) for seed in (5, 5, 6))
    assert_array_equal(one, same)
    assert np.abs(one - other).max() > 1e-9


def test_a_perceptron_predicts_as_scikit_learn_does(places, others):
    from sklearn.neural_network import MLPRegressor

    at, errors = places, error_at(places)
    library = MLPRegressor(
        hidden_layer_sizes=(8,), activation="tanh", solver="lbfgs", alpha=1e-2, max_iter=2000, random_state=1
    )
    standard = (errors - errors.mean(axis=0)) / errors.std(axis=0)
    library.fit((at - at.mean(axis=0)) / at.std(axis=0), standard)
    expected = library.predict((others - at.mean(axis=0)) / at.std(axis=0)) * errors.std(axis=0) + errors.mean(axis=0)
    assert_allclose(Perceptron(8, 1e-2, 1).fit(at, errors).errors(others), expected, atol=1e-9)


def test_a_missing_library_is_reported_with_the_command_that_installs_it(places, monkeypatch):
    real = builtins.__import__

    def without(name, *rest, **more):
        if name.split(".")[0] == "sklearn":
            raise ModuleNotFoundError(name)
        return real(name, *rest, **more)

    for name in [name for name in sys.modules if name.split(".")[0] == "sklearn"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(LibraryMissing, match=r"pip install 'cellctl\[baselines\]'"):
        Perceptron().fit(places, error_at(places))


def test_between_grid_points_the_error_is_the_distance_weighted_mean_of_the_corners():
    corners = np.array([[x, y, z] for x in (0.0, 100.0) for y in (0.0, 100.0) for z in (0.0, 100.0)])
    more = np.concatenate([corners, [[300.0, 300.0, 300.0]] * 2])  # far: its weight at a corner is 0
    errors = np.concatenate([corners / 100.0, [[9.0, 9.0, 9.0]] * 2])
    at = np.array([20.0, 30.0, 40.0])
    weights = 1.0 / np.linalg.norm(corners - at, axis=1) ** 3
    expected = weights @ (corners / 100.0) / weights.sum()
    assert_allclose(GridInverseDistance(100.0, 3.0).fit(more, errors).errors(at), [expected], atol=1e-12)


def test_tuning_takes_the_candidate_with_the_smallest_held_out_error(places):
    errors = error_at(places)
    tuned = tuned_grid(places)
    found = tuned.fit(places, errors)
    folds = grouped_folds(places, tuned.folds, tuned.seed)
    again = [held_out_rms(each, places, errors, folds) for each in tuned.candidates]
    assert found.rms == tuple(again)
    assert found.method == tuned.candidates[int(np.argmin(again))]


@pytest.mark.long
def test_tuning_prefers_the_penalty_that_noise_needs(places):
    noisy = 0.05 * error_at(places) + np.random.default_rng(1).normal(0.0, 0.1, (160, 3))
    strong = tuned_perceptron(hidden=[8], alphas=[1e-3, 30.0])
    assert strong.fit(places, noisy).method.alpha == 30.0
    assert strong.fit(places, error_at(places)).method.alpha == 1e-3


def test_a_tuned_perceptron_is_nearer_than_a_tuned_grid_on_a_smooth_error(places, others):
    errors, true = error_at(places), error_at(others)
    perceptron = tuned_perceptron(hidden=[16], alphas=[1e-2]).fit(places, errors)
    grid = tuned_grid(places).fit(places, errors)
    assert rms(perceptron.errors(others), true) < 0.5 * rms(grid.errors(others), true)
