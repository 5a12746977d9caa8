"""Semivariograms against their definition, and the fit of the Gaussian model against another optimiser."""

from itertools import combinations

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.distance import pdist

from cellctl.error_maps.kriging import RANGES, fitted_model, semivariogram

RNG = np.random.default_rng(3)
CENTRE = np.linspace(0.1, 4.0, 20)


def gaussian(h, nugget, sill, length):
    return nugget + sill * (1.0 - np.exp(-3.0 * h**2 / length**2))


def test_a_semivariogram_is_the_mean_of_half_the_squares_in_each_of_twenty_bins():
    values, points = RNG.normal(size=40), RNG.normal(size=(40, 2))
    h = np.array([np.linalg.norm(points[i] - points[j]) for i, j in combinations(range(40), 2)])
    found = semivariogram(h, values)
    halves = np.array([(values[i] - values[j]) ** 2 / 2 for i, j in combinations(range(40), 2)])
    edges = np.linspace(h.min(), h.max(), 21)
    for number in range(20):
        mine = (h >= edges[number]) & ((h < edges[number + 1]) | (number == 19))
        assert found.pairs[number] == mine.sum()
        if mine.any():
            assert found.gamma[number] == pytest.approx(halves[mine].mean())
        assert found.centre[number] == pytest.approx(edges[number : number + 2].mean())
    assert found.pairs.sum() == 780


@pytest.mark.parametrize(("nugget", "sill", "length"), [(0.1, 0.9, 1.5), (0.0, 1.2, 3.0), (0.5, 0.5, 0.8)])
def test_the_gaussian_model_is_found_from_its_own_semivariogram(nugget, sill, length):
    gamma = gaussian(CENTRE, nugget, sill, length)
    found = fitted_model(CENTRE, gamma)
    assert (found.nugget, found.sill, found.range) == pytest.approx((nugget, sill, length), abs=2e-3)
    assert found.rms < 1e-4
    assert found.at(CENTRE) == pytest.approx(gamma, abs=1e-3)


@pytest.mark.parametrize("seed", range(6))
def test_no_other_gaussian_model_has_a_smaller_sum_of_squares_over_the_bins_with_pairs(seed):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1.0, 1.0, (40, 3))
    found = semivariogram(pdist(points), np.sin(2.0 * points[:, 0]) + rng.normal(0.0, 0.2, 40))
    there = found.pairs > 0
    h, gamma = found.centre[there], found.gamma[there]
    greatest = pdist(points).max()
    limits = ([0.0, 0.0, RANGES[0] * greatest], [10.0, 50.0, RANGES[-1] * greatest])
    others = [least_squares(lambda x: gaussian(h, *x) - gamma, [0.1, 1.0, start], bounds=limits) for start in (1, 2, 4)]
    assert len(h) * found.model.rms**2 <= min(2.0 * other.cost for other in others) * (1.0 + 1e-6)


def test_a_semivariogram_that_does_not_rise_has_no_sill_and_no_range():
    found = fitted_model(CENTRE, np.linspace(1.2, 0.8, 20))
    assert found.sill == 0.0
    assert np.isnan(found.range)
    assert found.at(np.array([1.0])) == pytest.approx(1.0)


def test_empty_bins_have_no_semivariance_and_three_bins_no_model():
    found = semivariogram(np.array([1.0, 2.0, 4.0]), np.array([0.0, 1.0, 3.0]))
    assert np.array_equal(np.isnan(found.gamma), found.pairs == 0)
    assert np.count_nonzero(found.pairs) == 3
    assert found.model is None


def test_pairs_at_one_distance_have_no_semivariogram():
    found = semivariogram(np.ones(3), np.array([0.0, 1.0, 3.0]))
    assert found.pairs.sum() == 0
    assert found.model is None
