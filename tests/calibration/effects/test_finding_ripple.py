"""Joints that ripple here, at waves that the search is not told."""

import numpy as np
import pytest

from cellctl.calibration.effects import find_ripple

RIPPLE = {(1, 17): 2e-4, (2, 17): 3e-4, (2, 24): 1e-4, (5, 8): 6e-4}


def rippling(arm, rng, ripple, noise, rows=400):
    """Rows of an arm whose joints ripple: joint columns, residuals (mm), angles, and the geometry's columns."""
    q = rng.uniform(-np.pi, np.pi, (rows, arm.n))
    true = q.copy()
    for (joint, order), amplitude in ripple.items():
        true[:, joint - 1] += amplitude * np.sin(order * q[:, joint - 1] + joint + order)
    tip, last, chain = arm.tip, arm.n - 1, arm.chain()
    residual = arm.moved(true, last, tip) - arm.moved(q, last, tip) + noise * rng.normal(size=(rows, 3))
    return chain.tool_jacobian(q)[:, :3], residual, q, chain.parameter_jacobian(q)[:, :3]


def test_the_waves_of_each_joint_are_found_the_strongest_first(six_joints, rng):
    found = find_ripple(*rippling(six_joints, rng, RIPPLE, noise=0.03))
    assert found[0] == (2, 17)
    assert set(found) == set(RIPPLE)


def test_noise_makes_no_waves(six_joints, rng):
    noise_alone = [find_ripple(*rippling(six_joints, rng, {}, noise=0.05, rows=100)) for _ in range(10)]
    assert noise_alone == [()] * 10


def test_what_the_geometry_explains_is_no_wave(six_joints, rng):
    columns, residual, q, geometry = rippling(six_joints, rng, {}, noise=0.01)
    wrong = geometry @ rng.normal(scale=1e-3, size=geometry.shape[-1])
    assert find_ripple(columns, residual + wrong, q, geometry) == ()


def test_no_more_waves_than_asked_for(six_joints, rng):
    assert find_ripple(*rippling(six_joints, rng, RIPPLE, noise=0.03), at_most=1) == ((2, 17),)


@pytest.mark.parametrize("rows", [0, 1, 10])
def test_too_few_rows_make_no_waves(six_joints, rng, rows):
    assert find_ripple(*rippling(six_joints, rng, RIPPLE, noise=0.03, rows=rows)) == ()


def test_a_joint_that_moves_nothing_here_makes_no_waves(six_joints, rng):
    columns, residual, q, geometry = rippling(six_joints, rng, {(2, 17): 3e-4}, noise=0.03)
    columns[..., 5] = 0.0
    assert find_ripple(columns, residual, q, geometry) == ((2, 17),)
