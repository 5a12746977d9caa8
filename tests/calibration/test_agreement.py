"""Two calibrations of one robot, compared by their own covariances."""

from dataclasses import replace

import numpy as np
import pytest

from cellctl.calibration.problem.measured_region import radius_95
from cellctl.calibration.verdict.agreement import Agreement, Calibration, agreement
from tests.helpers.arms import KR5_ERRORS, kr5_model
from tests.helpers.simulated_setups import KR5_SIGNS, TOUCHED_REGION
from tests.studies.methods_that_agree import compared

SIGMA = 0.2
"""1 σ of each simulated calibration, in tolerances."""


def q_of(count=150):
    return np.random.default_rng(8).uniform(*TOUCHED_REGION, (count, 6)) * KR5_SIGNS


def drawn(rng, sigma=SIGMA, stated=SIGMA, truth=None, open_names=()):
    """A calibration of the KR5 whose error is `sigma` tolerances in each parameter of the arm, and stated as `stated`;
    open_names: not determined, at the prior's mean.
    """
    model = kr5_model(errors={}).robot_model()
    arm = np.array([each.of_the_arm for each in model.parameters])
    tolerance = np.where(arm, np.where(model.parameter_turns, 1e-3, 0.5), 0.0)
    known = arm & ~np.isin(model.names, open_names)
    values = np.where(known, (truth + sigma * rng.normal(size=len(arm))) * tolerance, 0.0)
    variance = np.where(known, stated**2, 1.0) * tolerance**2
    return Calibration(model.with_deviations(values), np.diag(variance), tolerance**2)


def pair(seed, *, sigma=SIGMA, stated=SIGMA, **options) -> Agreement:
    rng = np.random.default_rng(seed)
    truth = rng.normal(size=len(kr5_model().parameters))
    a, b = (drawn(rng, sigma, stated, truth, **options) for _ in range(2))
    return agreement(a, b, q_of(), a.model.chain.tool_now)


def test_the_95_percent_radius_is_161_times_the_rms_of_the_three_axes():
    assert radius_95() == pytest.approx(1.614, abs=1e-3)
    away = np.random.default_rng(1).normal(size=(100_000, 3))
    assert np.mean(np.linalg.norm(away, axis=1) <= radius_95() * np.sqrt(3.0)) == pytest.approx(0.95, abs=0.003)


def test_calibrations_with_right_sigmas_agree_and_the_distance_is_one_per_degree_of_freedom():
    found = [pair(seed) for seed in range(40)]
    assert np.mean([each.figures.distance for each in found]) == pytest.approx(1.0, abs=0.12)
    assert np.mean([each.figures.within for each in found]) > 0.9
    assert sum(each.verdict == "disagree" for each in found) <= 2
    assert sum(each.verdict == "agree" for each in found) >= 32


def test_a_sigma_that_is_too_small_is_a_disagreement_and_one_too_large_is_no_agreement():
    assert {pair(seed, stated=SIGMA / 3.0).verdict for seed in range(5)} == {"disagree"}
    large = [pair(seed, sigma=SIGMA / 4.0) for seed in range(5)]
    assert {each.verdict for each in large} == {"not known"}
    assert all(each.figures.within == 1.0 for each in large)
    assert "too large to tell" in large[0].sentence


def test_base_and_tool_do_not_count():
    rng = np.random.default_rng(3)
    a, b = (drawn(rng, truth=np.zeros(len(kr5_model().parameters))) for _ in range(2))
    moved = b.model.with_deviations(
        b.model.deviations + [300.0 if name.startswith(("base_x", "tool_z")) else 0.0 for name in b.model.names]
    )
    plain, same = (agreement(a, each, q_of(), np.eye(4)) for each in (b, replace(b, model=moved)))
    assert same.figures.distance == pytest.approx(plain.figures.distance, rel=1e-6)


def test_what_not_both_determined_is_named_and_not_compared():
    found = pair(2, open_names=("a2", "theta3"))
    assert set(found.not_determined) >= {"a2", "θ3"}
    assert found.degrees_of_freedom < pair(2).degrees_of_freedom


def test_hardly_determined_calibrations_are_not_judged():
    found = pair(1, stated=0.9)
    assert (found.verdict, found.degrees_of_freedom) == ("not known", 0)
    assert "6 are needed" in found.sentence


@pytest.mark.long
def test_spheres_and_tracker_agree_on_simulated_robots_and_a_wrong_scale_of_the_tracker_does_not_pass():
    right, wrong = ([compared(seed, case)[0] for seed in range(1, 5)] for case in ("none", "tracker 200 ppm"))
    assert all(each.verdict != "disagree" for each in right)
    assert np.mean([each.figures.within for each in right]) >= 0.9
    assert 0.6 <= np.mean([each.figures.distance for each in right]) <= 1.6
    assert all(each.verdict == "disagree" for each in wrong)
    assert np.mean([each.figures.scale_ppm for each in wrong]) == pytest.approx(200.0, abs=60.0)


def test_errors_of_the_table_are_the_same_robot():
    model = kr5_model(errors=KR5_ERRORS)
    variances = np.array([each.prior_sigma for each in model.parameters]) ** 2
    one = Calibration(model.robot_model(), np.array(model.covariance), variances)
    found = agreement(one, one, q_of(), np.eye(4))
    assert found.whole_rms_mm == pytest.approx(0.0, abs=1e-9)
    assert found.verdict == "not known"  # equal beyond any σ: not two calibrations
