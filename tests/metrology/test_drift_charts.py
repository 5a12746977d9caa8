"""Drift charts: their variance and false alarms are as stated, for any σ and gaps; too small a σ is noticed."""

from __future__ import annotations

import numpy as np
import pytest

from cellctl.metrology.drift_charts import (
    BASELINE,
    WEIGHT,
    alarm_limit,
    common_change,
    drift_charts,
    found_shift,
    noise_scale,
    recent_change,
    scale_error,
    squared_differences,
)

RUNS = 14


def coefficients(sigmas: np.ndarray) -> np.ndarray:
    """Of a chart's mean (R) by the runs' values (R): the chart of a unit pulse in each run."""
    pulses = np.eye(len(sigmas))
    return drift_charts(pulses, np.tile(sigmas[:, None], len(sigmas))).mean


def test_a_chart_is_the_moving_average_less_the_weighted_reference() -> None:
    sigmas = np.random.default_rng(1).uniform(0.5, 2.0, RUNS)
    found, run = coefficients(sigmas)[-1], RUNS - 1
    recent = np.where(np.arange(RUNS) > 0, (1.0 - WEIGHT) ** (run - np.arange(RUNS)), 0.0)
    reference = np.where(np.arange(RUNS) <= BASELINE, sigmas**-2.0, 0.0)
    np.testing.assert_allclose(found, recent / recent.sum() - reference / reference.sum(), atol=1e-12)


def test_its_sigma_is_that_of_its_weights_at_every_run_the_reference_included() -> None:
    sigmas = np.random.default_rng(2).uniform(0.5, 2.0, RUNS)
    found = coefficients(sigmas)
    stated = drift_charts(np.zeros(RUNS), sigmas).sigma
    np.testing.assert_allclose(stated[1:], np.sqrt(np.sum((found[1:] * sigmas) ** 2, axis=1)), rtol=1e-12)
    np.testing.assert_allclose(found[1:].sum(axis=1), 0.0, atol=1e-12)  # no robot's own value is in it
    assert np.isnan(stated[0])


def test_the_change_of_now_is_that_of_the_runs_since_a_step_with_its_own_sigma() -> None:
    rng, sigmas = np.random.default_rng(8), np.random.default_rng(9).uniform(0.5, 2.0, RUNS)
    step = np.where(np.arange(RUNS) >= 11, 7.0, 0.0)
    assert recent_change(step, sigmas, 11)[0] == pytest.approx(7.0)
    found = np.array([recent_change(row * sigmas + step, sigmas, 11) for row in rng.normal(size=(4000, RUNS))])
    assert found[:, 0].mean() == pytest.approx(7.0, abs=0.1)
    assert found[:, 0].std() == pytest.approx(found[0, 1], rel=0.05)


def test_a_run_without_the_parameter_changes_nothing() -> None:
    rng = np.random.default_rng(3)
    values, sigmas = rng.normal(size=RUNS), rng.uniform(0.5, 2.0, RUNS)
    without = [place for place in range(RUNS) if place not in (3, 9)]
    gaps = np.where(np.isin(np.arange(RUNS), without), values, np.nan)
    found, short = drift_charts(gaps, sigmas), drift_charts(values[without], sigmas[without])
    np.testing.assert_allclose(found.mean[without], short.mean)
    np.testing.assert_allclose(found.sigma[without], short.sigma)
    assert np.isnan(found.ratio[[3, 9]]).all()


def test_a_value_without_sigma_is_refused() -> None:
    with pytest.raises(ValueError, match="no positive σ"):
        drift_charts([1.0, 2.0], [1.0, 0.0])


def test_a_robot_with_all_its_charts_has_at_most_one_false_alarm_in_five_years_on_average() -> None:
    rng, charts, runs, robots = np.random.default_rng(4), 20, 60, 2000
    root = np.linalg.cholesky(0.6 * np.eye(charts) + 0.4)  # the parameters of a fit depend on each other
    values = rng.normal(size=(runs + 1, robots, charts)) @ root.T
    limit = alarm_limit(charts, runs)
    beyond = np.abs(drift_charts(values, np.ones(values.shape)).ratio[1:]) > limit
    outside = beyond.sum(axis=(0, 2))
    assert abs(outside.mean() - 1.0) < 4.0 * outside.std() / np.sqrt(robots)  # what the limit is made for, exactly
    raised = (beyond & ~np.concatenate([np.zeros((1, robots, charts), bool), beyond[:-1]])).sum(axis=(0, 2))
    assert 0.2 < raised.mean() < 1.0


def test_a_step_of_the_stated_size_is_found_within_the_stated_runs() -> None:
    rng, runs, robots, after = np.random.default_rng(5), 30, 4000, 10
    limit = alarm_limit(20, 60)
    values = rng.normal(size=(runs + after, robots))
    charts = drift_charts(values, np.ones(values.shape))
    step = found_shift(limit, charts.sigma[-1, 0], after)
    values[runs:] += step
    found = (np.abs(drift_charts(values, np.ones(values.shape)).ratio[runs:]) > limit).any(axis=0).mean()
    assert 0.9 <= found < 0.97
    values[runs:] -= 0.5 * step
    assert (np.abs(drift_charts(values, np.ones(values.shape)).ratio[runs:]) > limit).any(axis=0).mean() < 0.3


def test_the_scatter_of_runs_shows_a_sigma_that_is_too_small_and_no_step_or_drift() -> None:
    rng, runs = np.random.default_rng(6), 61
    values, stated = 2.0 * rng.normal(size=(runs, 500)), np.ones((runs, 500))
    each = [noise_scale(column) for column in squared_differences(values, stated).T]
    assert np.mean(each) == pytest.approx(2.0, rel=0.02)
    assert np.std(each) / 2.0 == pytest.approx(float(scale_error(runs - 1)), rel=0.1)
    moved = values + np.where(np.arange(runs)[:, None] > 30, 20.0, 0.0) + 0.02 * np.arange(runs)[:, None]
    assert noise_scale(squared_differences(moved, stated)) == pytest.approx(2.0, rel=0.03)
    assert np.isnan(noise_scale(np.full(3, np.nan)))


def test_what_most_robots_have_in_common_is_found_and_a_few_that_moved_alone_are_not() -> None:
    rng = np.random.default_rng(7)
    for robots in (3, 4, 10, 31):
        means, sigmas = rng.normal(size=(robots, 20000)), np.ones((robots, 20000))
        change, sigma = common_change(means, sigmas)
        assert np.mean(np.abs(change) > 2.5 * sigma) < 0.0124 * 1.15  # never more than of a normal variable
    means[:3] += 50.0
    change, sigma = common_change(means, sigmas)
    assert np.mean(np.abs(change / sigma)) < 1.5
    means += 2.0
    means[3, :] = np.nan
    change, sigma = common_change(means, sigmas)
    assert np.mean(change / sigma > 4.0) > 0.9
