"""What residual models are asked besides what every effect is: what they leave open, where, and in which bands."""

import numpy as np
import pytest

from cellctl.calibration.effects import Discrepancy, Harmonics, functions, kinds
from cellctl.calibration.model.postures import Postures
from cellctl.calibration.problem.measured_region import MeasuredRegion
from tests.helpers.arms import library_robot


def test_harmonics_straightness_field_and_discrepancy_are_the_random_functions():
    assert functions() == {"harmonics", "straightness", "field", "discrepancy"} < set(kinds())


def test_what_a_discrepancy_leaves_open_is_counted_once_by_the_measured_region():
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 3))
    model = Discrepancy(q, 1.0, 0.2)
    assert model.far_sigma(model.sigma) == pytest.approx(0.2)
    assert not model.variance(library_robot("ur10").chain(), Postures(q + 50.0)).any()
    assert not model.outside(Postures(q + 50.0)).any()


def test_the_measured_region_reaches_as_far_as_its_postures():
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (200, 3))
    region = MeasuredRegion.of(q, outside_mm=0.4)
    assert region.outside(q).mean() < 0.05
    assert region.outside(q + 50.0) == pytest.approx(np.full(200, 0.4))


def test_harmonics_reduced_to_a_band_keep_its_waves_and_no_other():
    model = Harmonics(2)
    kept = model.reduced({model.parameters[0].band})
    assert kept.waves == ((1, 1), (1, 2))
    assert {parameter.band for parameter in kept.parameters} == {model.parameters[0].band}
    assert kept.reduced(()).parameters == ()
