"""Robots whose links were made longer here, against growth by temperature."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cellctl.calibration.effects import ThermalExpansion
from cellctl.calibration.model.postures import Postures

STEEL, ALUMINIUM = 1.2e-5, 2.3e-5


def flanges(arm, q):
    return arm.moved(np.asarray(q), arm.n - 1, arm.flange[:3, 3])


def test_each_link_grows_by_its_own_share_exactly(arm, rng):
    q, delta_t = rng.uniform(-np.pi, np.pi, (6, arm.n)), rng.uniform(-5, 15, 6)
    per_kelvin = rng.uniform(STEEL, ALUMINIUM, arm.n)
    shift = ThermalExpansion(arm.n).shifts(arm.chain(), Postures(q, delta_t=delta_t)) @ per_kelvin
    for row, kelvin, found in zip(q, delta_t, shift, strict=True):
        rows = [
            (theta, d * (1 + kelvin * share), a * (1 + kelvin * share), alpha)
            for (theta, d, a, alpha), share in zip(arm.rows, per_kelvin, strict=True)
        ]
        grown = type(arm)(arm.lean, rows)
        assert_allclose(found, (flanges(grown, [row]) - flanges(arm, [row]))[0], atol=1e-9)


def test_a_robot_that_is_evenly_warm_is_its_own_enlargement(arm, rng):
    q = rng.uniform(-np.pi, np.pi, (6, arm.n))
    shift = ThermalExpansion(arm.n).shifts(arm.chain(), Postures(q, delta_t=np.full(6, 10.0))) @ np.full(arm.n, STEEL)
    assert_allclose(shift, 10.0 * STEEL * flanges(arm, q), atol=1e-9)


def test_the_pedestal_grows_with_the_first_link(six_joints):
    tall = ThermalExpansion(6).shifts(six_joints.chain(), Postures(np.zeros((1, 6)), delta_t=np.array([10.0])))[0, :, 0]
    assert tall[2] == pytest.approx(10.0 * 400.0)


def test_the_temperature_at_which_lengths_hold_moves_nothing(six_joints):
    at = Postures(np.ones((2, 6)), delta_t=np.zeros(2))
    assert not ThermalExpansion(6).shifts(six_joints.chain(), at).any()


def test_rows_without_a_temperature_do_not_grow(six_joints):
    assert not ThermalExpansion(6).shifts(six_joints.chain(), Postures(np.ones((2, 6)))).any()
