"""95 % regions are wider where held-out rows of the fit are too often outside them, and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest

from cellctl.calibration import PositionRows, Split, Task, fit, prediction_sigma
from cellctl.calibration.problem.measured_region import radius_95
from cellctl.formats import nominal_model
from tests.helpers.honesty import fitted as fit_of
from tests.helpers.simulated_setups import positions, sph, with_wild_rows
from tests.helpers.unmodelled import TUNING

SIGMA, FIT, HELD_OUT = 0.02, 900, 1000
LOW, HIGH = np.array([-90, -110, 40, -170, -100, -170.0]), np.array([90, -30, 120, 170, 100, 170.0])


@pytest.fixture
def fitted(kr5):
    """Fits a KR5 to positions, σ 0.02 mm as stated times `size` of each row, and predicts 1000 others."""

    def of(rng, size):
        nominal = nominal_model(kr5, touched=False)
        true = nominal.with_deviations(rng.normal(0.0, np.where(nominal.parameter_turns, 3e-4, 0.2)))
        q = kr5.joint_map().model(rng.uniform(LOW, HIGH, (FIT + HELD_OUT, 6)))
        xyz = true.tcp(q) + rng.normal(0.0, SIGMA, (FIT + HELD_OUT, 3)) * size[:, None]
        task = Task(nominal, PositionRows(q, xyz, np.full(xyz.shape, SIGMA)))
        return fit(task, Split.by_column(np.arange(len(q)) >= FIT))

    return of


@pytest.mark.parametrize("seed", [0, 1])
def test_rows_with_heavier_tails_than_the_normal_distribution_get_wider_regions(fitted, seed):
    """Three rows of ten 1.8 times as noisy: with the variance of all 92.4 % of the rows would be in their regions
    (χ² of three numbers); 95 % of 900 rows are known to 0.7 %.
    """
    rng = np.random.default_rng([seed, 41])
    result = fitted(rng, rng.choice([1.0, 1.8], FIT + HELD_OUT, p=[0.7, 0.3]))
    assert result.reliability.tails > 1.05
    assert 0.92 < result.coverage_95 < 0.97


def test_rows_as_noisy_as_stated_are_left_as_they_are(fitted):
    rng = np.random.default_rng(42)
    result = fitted(rng, np.ones(FIT + HELD_OUT))
    assert result.reliability.tails == 1.0
    np.testing.assert_array_equal(result.identification.noise, np.ones(3))
    assert 0.92 < result.coverage_95 < 0.97


def test_a_noise_that_is_larger_by_one_factor_is_found_as_such_and_not_raised_again(fitted):
    rng = np.random.default_rng(43)
    result = fitted(rng, np.full(FIT + HELD_OUT, 3.0))
    assert result.reliability.tails == 1.0
    np.testing.assert_allclose(result.identification.noise, 3.0, rtol=0.1)


@pytest.mark.long
def test_touches_that_show_a_model_error_enlarge_every_sigma_and_positions_do_not():
    """Decision 76 has the factor, from robots whose effects tuned σ."""
    lacking = TUNING["these three"](1000)
    touched, clean, seen = (
        fit_of(sph(1000, besides=lacking)),
        fit_of(sph(1000)),
        fit_of(positions(1000, besides=lacking)),
    )
    assert [each.region.model_error_scale for each in (touched, clean, seen)] == [1.25, 1.0, 1.0]
    best, q = touched.identification.identified, sph(1000).asked
    model, robot = best.state.model, best.unknowns.robot
    scaled, plain = (
        prediction_sigma(model, best.covariance[:robot, :robot], q, region)
        for region in (touched.region, replace(touched.region, model_error_scale=1.0))
    )
    np.testing.assert_allclose(scaled, 1.25 * plain)
    assert touched.region.radius_95 == pytest.approx(radius_95(8.0))
    assert [each.region.radius_95 for each in (clean, seen)] == [radius_95(), radius_95()]


def test_a_touch_that_is_left_out_may_be_a_model_error_and_enlarges_sigma():
    with_outliers = fit_of(with_wild_rows(sph(1), 15.0))
    assert with_outliers.left_out
    assert (with_outliers.growth, with_outliers.region.model_error_scale) == (1.0, 1.25)


def test_errors_of_an_unknown_scale_are_within_the_radius_of_its_degrees_of_freedom_with_95_percent():
    rng = np.random.default_rng(2)
    scale = np.sqrt(8.0 / rng.chisquare(8.0, 100_000))
    lengths = np.linalg.norm(rng.normal(size=(100_000, 3)), axis=1) * scale
    assert np.mean(lengths <= radius_95(8.0) * np.sqrt(3.0)) == pytest.approx(0.95, abs=0.003)
