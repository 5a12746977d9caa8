"""Joints on springs behind their motors: from currents to joint angles, and back by a fit."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cellctl.calibration.effects import EffectInputs, MotorTorsion
from cellctl.calibration.model.postures import Postures

TRUE = np.array([1.2e-4, 2.5e-4, 1.8e-4, 0.9e-4, 1.5e-4, 0.6e-4])


@pytest.fixture
def at(rng):
    return Postures(rng.uniform(-1.5, 1.5, (120, 6)), currents=rng.normal(0.0, 2.0, (120, 6)))


def test_a_joint_lags_in_proportion_to_its_own_current(six_joints, at):
    turned = MotorTorsion(6).turns(six_joints.chain(), at) @ TRUE
    assert_allclose(turned, -TRUE * at.currents)


def test_rows_without_currents_do_not_lag_and_a_prediction_says_so(six_joints, at):
    effect, currents = MotorTorsion(6), at.currents.copy()
    currents[[2, 5], 3] = np.nan
    partly, none = Postures(at.q, currents=currents), Postures(at.q)
    assert not effect.turns(six_joints.chain(), none).any()
    assert np.isfinite(effect.turns(six_joints.chain(), partly)).all()
    assert effect.lacks(at) == []
    (words,) = effect.lacks(partly)
    assert words == "2 of 120 rows without I1…I6: predicted without flexibility by motor current"
    assert effect.lacks(none)[0].startswith("120 of 120 rows")


def test_only_currents_in_every_row_that_change_support_it(six_joints, at):
    def made(currents):
        return MotorTorsion.of_inputs(EffectInputs(six_joints.chain(), Postures(at.q, currents=currents)))

    one_missing = at.currents.copy()
    one_missing[7, 0] = np.nan
    assert made(at.currents) == MotorTorsion(6)
    assert made(None) is None
    assert made(one_missing) is None
    assert made(np.full((120, 6), 1.5)) is None
