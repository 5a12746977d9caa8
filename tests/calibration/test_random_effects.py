"""Mean and spread of a type from robots that their rows determine partly."""

import numpy as np
import pytest

from cellctl.calibration.random_effects import RandomEffects, of_rows_alone

PARAMETERS = 12


def robots(seed, count, mean, spread, sigma):
    """Λ and η of robots from N(mean, spread²), each parameter measured with `sigma` (P,), inf: not at all."""
    rng = np.random.default_rng(seed)
    true = mean + spread * rng.normal(size=(count, PARAMETERS))
    sigma = np.broadcast_to(sigma, PARAMETERS)
    weight = np.where(np.isinf(sigma), 0.0, 1.0 / sigma**2)
    seen = true + np.where(np.isinf(sigma), 0.0, sigma) * rng.normal(size=true.shape)
    return np.tile(np.diag(weight), (count, 1, 1)), seen * weight


def test_mean_and_spread_of_a_type_are_found_through_the_noise_of_each_robot():
    mean = 0.5 * np.resize([1.0, -1.0], PARAMETERS)
    found = [RandomEffects.of(*robots(seed, 20, mean, 0.25, 0.2)) for seed in range(8)]
    assert all(each.supported for each in found)
    assert np.allclose(np.mean([each.mean for each in found], axis=0), mean, atol=0.06)
    spread = np.sqrt(np.mean([np.diag(each.spread) for each in found]))
    # the belief in the tolerance counts as one robot: EM's fixed point for these noises is 0.367
    assert 0.25 < spread < 0.4


def test_a_further_robot_is_in_its_region_as_often_as_stated():
    squares = []
    for seed in range(40):
        found = RandomEffects.of(*robots(seed, 8, 0.4, 0.5, 0.1))
        rng = np.random.default_rng(1000 + seed)
        away = 0.4 + 0.5 * rng.normal(size=PARAMETERS) - found.mean
        squares += (away**2 / np.diag(found.predicted)).tolist()
    assert 0.6 < np.mean(squares) < 1.1


def test_robots_without_a_common_part_support_no_prior():
    found = [RandomEffects.of(*robots(seed, 20, 0.0, 1.0, 0.1)) for seed in range(8)]
    assert not any(each.supported for each in found)
    assert all((np.diag(each.predicted) >= 1.0).all() and not each.mean.any() for each in found)


def test_what_no_row_shows_keeps_its_tolerance():
    sigma = np.where(np.arange(PARAMETERS) < 4, np.inf, 0.1)
    found = RandomEffects.of(*robots(3, 20, 0.5, 0.25, sigma))
    assert np.abs(found.mean[:4]).max() < 1e-9
    assert (np.diag(found.predicted)[:4] >= 1.0).all()
    assert (np.diag(found.predicted)[4:] < 0.4).all()


def test_few_robots_have_heavier_tails_and_two_are_refused():
    few, many = (RandomEffects.of(*robots(1, count, 0.5, 0.25, 0.1)) for count in (4, 20))
    assert few.degrees_of_freedom < many.degrees_of_freedom
    assert np.diag(few.predicted).mean() > 2.0 * np.diag(many.predicted).mean()
    with pytest.raises(ValueError, match="2 robots"):
        RandomEffects.of(*robots(1, 2, 0.5, 0.25, 0.1))


def test_a_direction_that_all_robots_differ_in_together_is_a_common_factor():
    rng = np.random.default_rng(5)
    along = rng.normal(size=PARAMETERS)
    true = rng.normal(size=(30, 1)) * along + 0.1 * rng.normal(size=(30, PARAMETERS))
    found = RandomEffects.of(np.tile(np.eye(PARAMETERS) / 0.05**2, (30, 1, 1)), true / 0.05**2)
    assert found.factors == 1
    _, vectors = np.linalg.eigh(found.spread)
    assert abs(vectors[:, -1] @ along) > 0.98 * np.linalg.norm(along)


def test_a_posterior_without_its_own_prior_is_what_its_rows_say():
    rng = np.random.default_rng(2)
    jacobian, prior = rng.normal(size=(5, 8)), rng.uniform(0.5, 2.0, 8)  # five rows of eight parameters
    right = rng.normal(size=5)
    covariance = np.linalg.inv(jacobian.T @ jacobian + np.diag(prior**-2))
    tolerances = rng.uniform(0.5, 2.0, 8)
    information, gradient = of_rows_alone(covariance @ jacobian.T @ right, covariance, prior, tolerances)
    scaled = jacobian * tolerances
    assert np.allclose(information, scaled.T @ scaled, atol=1e-9)
    assert np.allclose(gradient, scaled.T @ right, atol=1e-9)
