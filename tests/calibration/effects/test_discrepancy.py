"""A Gaussian process over the postures, against its kernel written here."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cellctl.calibration.effects import Discrepancy
from cellctl.calibration.model.postures import Postures
from cellctl.calibration.model.residual_model import PostureBasis


def kernel(one, other, length):
    return np.exp(-0.5 * np.sum((one[:, None] - other[None]) ** 2, axis=2) / length**2)


@pytest.fixture
def centres(rng):
    return rng.uniform(-1.5, 1.5, (20, 6))


def covariance(effect, chain, q):
    """Prior covariance (N, 3, N, 3), mm², of the shifts at q (N, n)."""
    shifts = effect.shifts(chain, Postures(q)) * effect.sigma
    return np.einsum("nap,mbp->namb", shifts, shifts)


def test_between_its_centres_the_shifts_are_as_alike_as_the_kernel_says_on_each_axis_alone(six_joints, centres):
    effect = Discrepancy(centres, length_rad=1.3, expected=0.2)
    expected = 0.2**2 * np.einsum("nm,ab->namb", kernel(centres, centres, 1.3), np.eye(3))
    assert_allclose(covariance(effect, six_joints.chain(), centres), expected, atol=1e-5 * 0.2**2)


def test_what_the_centres_span_and_the_remainder_are_the_whole_variance_anywhere(six_joints, centres, rng):
    effect, q = Discrepancy(centres, 1.3, 0.2), rng.uniform(-3.0, 3.0, (50, 6))
    cross = kernel(q, centres, 1.3)
    square = kernel(centres, centres, 1.3)
    left = 1.0 - np.einsum("nm,nm->n", cross, np.linalg.solve(square, cross.T).T)  # a conditional variance
    assert_allclose(effect.basis.remainder(q), left, atol=1e-4)
    own = np.einsum("nana->na", covariance(effect, six_joints.chain(), q)) / 0.2**2
    assert_allclose(own + effect.basis.remainder(q)[:, None], np.ones((50, 3)), atol=1e-9)


def test_nothing_is_left_at_the_centres_and_all_far_away(centres):
    effect = PostureBasis(centres)
    assert effect.remainder(centres).max() < 1e-5
    assert effect.remainder(centres + 10.0).min() > 0.999


def test_no_two_centres_are_alike_and_all_postures_are_near_one(rng):
    q = rng.uniform(-1.0, 1.0, (40, 6))
    repeated = np.repeat(q, 5, axis=0) + rng.normal(0.0, 1e-4, (200, 6))
    effect = PostureBasis.over(repeated)
    apart = np.linalg.norm(effect.centres[:, None] - effect.centres[None], axis=2) + 10.0 * np.eye(len(effect.centres))
    assert len(effect.centres) == 40
    assert apart.min() > 0.05
    assert effect.remainder(repeated).max() < 0.01


def test_of_many_postures_at_most_64_are_centres_and_of_one_posture_one(rng):
    assert len(PostureBasis.over(rng.uniform(-1.0, 1.0, (500, 6))).centres) == 64
    assert len(PostureBasis.over(np.ones((30, 6))).centres) == 1
    assert len(PostureBasis.over(np.ones((1, 6))).centres) == 1


def test_the_length_is_that_at_which_half_of_the_rows_tell_of_the_others(rng):
    dense, sparse = rng.uniform(-0.5, 0.5, (300, 3)), rng.uniform(-3.0, 3.0, (60, 6))
    assert PostureBasis.over(dense).length_rad == 1.0
    assert PostureBasis.over(sparse).length_rad > 3.0
