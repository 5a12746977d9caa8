"""What residual models are asked besides what every effect is: what they leave open, where, and in which bands."""

import numpy as np
import pytest

from cellctl.calibration.effects import Discrepancy, Harmonics, functions, kinds
from cellctl.calibration.model.postures import Postures


def test_harmonics_and_the_discrepancy_are_the_random_functions():
    assert functions() == {"harmonics", "discrepancy"} < set(kinds())


def test_a_discrepancy_leaves_nothing_open_at_its_postures_and_all_of_it_far_away():
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 3))
    model = Discrepancy(q, 1.0, 0.2)
    assert model.variance(Postures(q)) == pytest.approx(np.zeros(20), abs=1e-5)
    assert model.variance(Postures(q + 50.0)) == pytest.approx(np.full(20, 0.04))
    assert model.outside(Postures(q + 50.0)) == pytest.approx(np.ones(20))


def test_harmonics_reduced_to_a_band_keep_its_waves_and_no_other():
    model = Harmonics(2)
    kept = model.reduced({model.parameters[0].band})
    assert kept.waves == ((1, 1), (1, 2))
    assert {parameter.band for parameter in kept.parameters} == {model.parameters[0].band}
    assert kept.reduced(()).parameters == ()
