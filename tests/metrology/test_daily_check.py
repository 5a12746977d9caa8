"""Daily check: false alarms as often as stated, changes found, and the reason that is given."""

from __future__ import annotations

import numpy as np
import pytest

from cellctl.metrology.daily_check import (
    HORIZON,
    RIGID_AND_SCALE,
    DailyAction,
    DailyBaseline,
    DailyReason,
    daily_check,
    ewma_limit,
    rigid_and_scale,
    simulated_ewma,
    t2_limit,
)

POINTS = np.random.default_rng(0).uniform([900, -400, 100], [1500, 400, 700], (10, 3))
SIGMA = 0.03


def runs(rng, count, moved=None):
    """Runs (count, 10, 3) with noise of each point and a common shift of each day."""
    noise = SIGMA * rng.normal(size=(count, 10, 3)) + SIGMA * rng.normal(size=(count, 1, 3))
    return POINTS + noise + (0.0 if moved is None else moved)


def baseline(rng, count=20):
    return DailyBaseline.of(runs(rng, count), POINTS, rigid_and_scale(POINTS), RIGID_AND_SCALE)


def scaled(ppm):
    return (POINTS - POINTS.mean(axis=0)) * ppm * 1e-6


def test_the_false_alarm_rate_of_t2_is_the_stated_one_with_20_baseline_runs():
    rng = np.random.default_rng(1)
    limit, alarms, count = t2_limit(20, 7, 0.05), 0, 1500
    for _ in range(count):
        base = baseline(rng)
        new = base.features(runs(rng, 1)[0])
        alarms += float(new @ np.linalg.solve(base.covariance, new)) > limit
    assert alarms / count == pytest.approx(0.05, abs=0.017)  # three standard deviations


@pytest.mark.parametrize("count", [20, 60])
def test_the_false_alarm_rate_of_the_ewma_is_the_stated_one_by_other_simulations(count):
    rate = 0.0027
    limit = ewma_limit(count, 7, 0.2, rate)
    found = simulated_ewma(count, 7, 0.2, HORIZON, np.random.default_rng(99))
    alarmed = np.mean((found > limit**2).any(axis=1))
    assert alarmed == pytest.approx(1.0 - (1.0 - rate) ** HORIZON, abs=0.03)


def test_with_a_very_long_baseline_one_feature_has_the_limit_of_the_textbook():
    """λ = 0.2, L = 2.962: in-control average run length 500 (Lucas and Saccucci 1990)."""
    assert ewma_limit(2000, 1, 0.2, 1.0 / 500.0) == pytest.approx(2.962, abs=0.08)


def test_an_unchanged_robot_is_in_control_for_most_of_a_hundred_runs():
    rng = np.random.default_rng(2)
    base, later = baseline(rng, 40), runs(rng, 100)
    verdicts = [daily_check(base, later[: count + 1]).action for count in range(100)]
    assert verdicts.count(DailyAction.RECALIBRATE) <= 5


def test_a_sudden_shift_is_measured_again_first_and_then_says_recalibrate():
    rng = np.random.default_rng(3)
    base = baseline(rng, 40)
    moved = np.concatenate([runs(rng, 5), runs(rng, 2, np.array([0.25, 0.0, 0.0]))])
    first, second = daily_check(base, moved[:6]), daily_check(base, moved)
    assert first.action is DailyAction.REPEAT
    assert (second.action, second.reason) == (DailyAction.RECALIBRATE, DailyReason.SHIFT)
    assert "Recalibrate" in second.words


def test_an_arm_that_expands_gives_scale_as_the_reason():
    rng = np.random.default_rng(4)
    base = baseline(rng, 40)
    found = daily_check(base, np.concatenate([runs(rng, 3), runs(rng, 2, scaled(300.0))]))
    assert (found.action, found.reason) == (DailyAction.RECALIBRATE, DailyReason.SCALE)


def test_a_slow_change_is_found_as_drift_before_a_single_run_shows_it():
    rng = np.random.default_rng(5)
    base = baseline(rng, 60)
    slow = np.array([0.004, 0.003, 0.0])
    later = np.stack([runs(rng, 1, day * slow)[0] for day in range(60)])
    verdicts = [daily_check(base, later[: day + 1]) for day in range(60)]
    first = next(one for one in verdicts if one.action is DailyAction.RECALIBRATE)
    assert first.reason is DailyReason.DRIFT
    assert first.t2 <= first.t2_limit


def test_a_single_bad_run_asks_for_another_and_does_not_spoil_the_next_days():
    rng = np.random.default_rng(6)
    base = baseline(rng, 60)
    bad = np.concatenate([runs(rng, 8), runs(rng, 1, np.array([0.0, 5.0, 0.0]))])
    found = daily_check(base, bad)
    assert (found.action, found.reason) == (DailyAction.REPEAT, DailyReason.SHIFT)
    assert "Measure the points again" in found.words
    assert daily_check(base, np.concatenate([bad, runs(rng, 1)])).action is DailyAction.IN_CONTROL


def test_fewer_than_twenty_baseline_runs_are_refused_and_more_features_need_more():
    rng = np.random.default_rng(7)
    with pytest.raises(ValueError, match="measure 20 at least"):
        baseline(rng, 19)
    with pytest.raises(ValueError, match="measure 35 at least"):
        DailyBaseline.of(runs(rng, 34), POINTS, np.eye(30), tuple(str(number) for number in range(30)))


def test_missing_points_are_refused():
    rng = np.random.default_rng(8)
    broken = runs(rng, 1)
    broken[0, 3, 1] = np.nan
    with pytest.raises(ValueError, match="measure the missing points again"):
        daily_check(baseline(rng), broken)
