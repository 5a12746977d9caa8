"""Joints that ripple here, at orders that the search is not told."""

import numpy as np
import pytest

from cellctl.calibration.effects import order_shares

ORDERS = range(3, 41)


def rippling(arm, rng, order, amplitude, noise=0.05):
    """Columns, residuals (mm) and angles of 400 rows of an arm whose joints 1 to 3 ripple."""
    q = rng.uniform(-np.pi, np.pi, (400, arm.n))
    true = q.copy()
    true[:, :3] += amplitude * np.sin(order * q[:, :3] + np.array([0.3, 1.9, -2.0]))
    tip, last = arm.tip, arm.n - 1
    residual = arm.moved(true, last, tip) - arm.moved(q, last, tip) + noise * rng.normal(size=(400, 3))
    return arm.chain().tool_jacobian(q)[:, :3], residual, q


@pytest.mark.parametrize("order", [5, 17, 34])
def test_the_order_of_a_ripple_is_found(six_joints, rng, order):
    shares = order_shares(*rippling(six_joints, rng, order, 2e-4), ORDERS)
    assert ORDERS[int(np.argmax(shares))] == order
    assert shares.max() > 0.8
    assert np.sort(shares)[-2] < 0.1


def test_noise_has_no_order(six_joints, rng):
    shares = order_shares(*rippling(six_joints, rng, 17, 0.0), ORDERS)
    assert shares.max() < 0.03
    assert abs(shares.mean()) < 0.005


def test_no_residual_has_no_order(six_joints, rng):
    columns, residual, q = rippling(six_joints, rng, 17, 0.0, noise=0.0)
    assert not order_shares(columns, residual, q, ORDERS).any()


def test_too_few_rows_are_refused(six_joints, rng):
    columns, residual, q = rippling(six_joints, rng, 17, 1e-4)
    with pytest.raises(ValueError, match="12 residuals for 12 amounts"):
        order_shares(columns[:4], residual[:4], q[:4], ORDERS)
