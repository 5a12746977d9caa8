"""A robot fitted with what others of its type were like."""

import numpy as np
import pytest

from cellctl.calibration.rows.type_rows import OF_TYPE, TypePrior
from tests.helpers.honesty import fitted
from tests.helpers.simulated_setups import PRIOR, positions
from tests.studies.prior_of_type import errors_of, measured, prior_of

NAMES = positions(1).nominal.link_names
TOLERANCES = np.array([PRIOR.sigma(name, ()) for name in NAMES])


def exact_type(mean, sigma):
    """The prior of a type with this mean and spread of each parameter, in tolerances."""
    return TypePrior(NAMES, mean * TOLERANCES, np.diag((sigma * TOLERANCES) ** 2))


def error(found, draw):
    return float(
        np.sqrt(np.mean(np.sum((found.predicted(draw.asked)[0] - draw.truth.points(draw.asked)) ** 2, axis=1)))
    )


def of_the_arm(found):
    names = found.identification.identified.unknowns.names
    at = [names.index(name) for name in NAMES]
    return found.identification.identified.deviations[at], found.identification.identified.covariance[np.ix_(at, at)]


def test_prior_and_tolerance_together_are_the_type_where_no_row_says_more():
    mean, sigma = 0.4 * np.resize([1.0, -1.0], len(NAMES)), 0.3
    found = fitted(positions(3, errors=dict.fromkeys(NAMES, 0.0), count=8), exact_type(mean, sigma))
    at = NAMES.index("theta1")  # the base takes it: no row of an instrument shows it
    values, covariance = of_the_arm(found)
    assert np.isclose(values[at], mean[at] * TOLERANCES[at], rtol=0.02)
    assert np.isclose(np.sqrt(covariance[at, at]), sigma * TOLERANCES[at], rtol=0.02)


def test_a_spread_as_wide_as_the_tolerance_changes_nothing():
    draw = positions(4, count=12)
    without, within = fitted(draw), fitted(draw, exact_type(np.full(len(NAMES), 0.3), 1.0))
    assert np.array_equal(without.found, within.found)


@pytest.mark.long
def test_eight_rows_are_worth_more_with_the_prior_of_the_others():
    runs = [fitted(measured("positions", 50, 5, robot, "common", again=False)) for robot in range(12)]
    errors = []
    for robot in range(12):
        prior, effects = prior_of(runs[:robot] + runs[robot + 1 :], NAMES)
        assert effects.supported
        draw = measured("positions", 8, 5, robot, "common", again=True)
        errors.append((error(fitted(draw, prior), draw), error(fitted(draw), draw)))
    within, without = np.sqrt(np.mean(np.square(errors), axis=0))
    assert within < 0.9 * without


def test_a_robot_unlike_its_type_is_noticed_and_not_forced_to_be_like_it():
    mean = 0.5 * np.resize([1.0, -1.0], len(NAMES))
    own = dict(zip(NAMES, (-3.0 * mean * TOLERANCES).tolist(), strict=True))
    draw = positions(6, errors=own, count=30)
    found, without = fitted(draw, exact_type(mean, 0.1)), fitted(draw)
    assert found.prior_scale[OF_TYPE] > 5.0
    assert error(found, draw) < 1.5 * error(without, draw)
    assert found.growth < 1.5


def test_a_robot_of_its_type_is_not_taken_for_another():
    fits = [
        fitted(
            positions(seed, errors=errors_of(1, seed, "common", NAMES), count=20),
            exact_type(0.5 * np.random.default_rng([1, 29]).choice([-1.0, 1.0], len(NAMES)), 0.25),
        )
        for seed in range(8)
    ]
    assert not any(OF_TYPE in found.prior_scale for found in fits)
