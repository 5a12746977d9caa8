"""Predicted errors against drawn ones, and what ends a campaign."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cellctl.calibration.distributions import weighted_chi2_ppf
from cellctl.planning.stopping import BatchProgress, ErrorBand, PredictedError, StopLimits, ended_by, root_after

LIMITS = StopLimits(goal_mm=0.1, rows=100, seconds=600.0, gain=0.02)
GOING = BatchProgress(rows=50, high_mm=0.2, next_mm=0.15, next_seconds=300.0)


@pytest.mark.parametrize(
    "weights",
    [[1.0], [1.0, 1.0, 1.0], [3.0, 0.1], [1.0, 0.5, 0.2, 0.01], 1.0 / np.arange(1, 40) ** 2, np.ones(300)],
    ids=["one", "three equal", "two", "four", "falling", "many"],
)
def test_quantiles_are_those_of_drawn_sums(weights) -> None:
    drawn = np.random.default_rng(1).standard_normal((200_000, len(weights))) ** 2 @ np.array(weights)
    found = [float(np.mean(drawn <= weighted_chi2_ppf(p, weights))) for p in (0.05, 0.5, 0.95)]
    assert found == pytest.approx([0.05, 0.5, 0.95], abs=0.016)
    assert found[2] == pytest.approx(0.95, abs=0.004)


def test_weights_in_other_units_scale_the_quantile_and_no_weight_gives_none() -> None:
    assert weighted_chi2_ppf(0.95, [4e-9, 2e-9, 0.0]) == pytest.approx(1e-9 * weighted_chi2_ppf(0.95, [4.0, 2.0]))
    assert weighted_chi2_ppf(0.95, [0.0, 0.0]) == weighted_chi2_ppf(0.95, []) == 0.0


@pytest.fixture
def problem():
    """A covariance whose parameters' units differ by six orders, places by them, and rows."""
    rng = np.random.default_rng(3)
    units = np.array([1e-4, 1e-4, 1.0, 10.0, 100.0, 0.0])
    root = rng.normal(size=(6, 6))
    rows = rng.normal(size=(12, 1, 6)) / np.where(units > 0.0, units, 1.0)
    return np.outer(units, units) * (root @ root.T), rng.normal(size=(60, 6)) / np.where(units > 0, units, 1.0), rows


def drawn_errors(covariance, asked, open_mm2=0.0):
    """Volumetric errors, mm, of parameters drawn from a covariance (P, P)."""
    rng = np.random.default_rng(5)
    free = np.diag(covariance) > 0
    sigma = np.sqrt(np.diag(covariance)[free])
    root = np.linalg.cholesky(covariance[np.ix_(free, free)] / np.outer(sigma, sigma))
    errors = rng.standard_normal((100_000, free.sum())) @ root.T * sigma @ asked[:, free].T
    beside = rng.standard_normal((100_000, 3)) ** 2 @ np.full(3, open_mm2 / 3.0)
    return np.sqrt(np.sum(errors**2, axis=1) / (asked.shape[0] / 3.0) + beside)


def test_the_band_is_that_of_drawn_robots(problem) -> None:
    covariance, asked, _ = problem
    band = PredictedError.of(covariance, asked, 0.5, 0.2).now
    drawn = np.quantile(drawn_errors(covariance, asked, 0.7), [0.05, 0.5, 0.95])
    assert [band.low_mm, band.median_mm, band.high_mm] == pytest.approx(drawn, rel=0.02)


def test_more_rows_give_the_band_of_the_covariance_after_them(problem) -> None:
    covariance, asked, rows = problem
    free = np.diag(covariance) > 0
    known = np.linalg.inv(covariance[np.ix_(free, free)]) + np.einsum("mkp,mkq->pq", rows, rows)[np.ix_(free, free)]
    after = np.zeros_like(covariance)
    after[np.ix_(free, free)] = np.linalg.inv(known)
    expected = PredictedError.of(after, asked, 0.0, 0.0).now
    found = PredictedError.of(covariance, asked, 0.0, 0.0).after(rows)
    assert found.high_mm == pytest.approx(expected.high_mm, rel=1e-6)
    root = root_after(covariance, rows)
    np.testing.assert_allclose(root @ root.T, after, rtol=1e-6, atol=1e-12)


def test_rows_never_lower_the_scatter_and_lower_the_rest(problem) -> None:
    covariance, asked, rows = problem
    scattered = PredictedError.of(covariance, asked, 0.0, 1.0)
    assert scattered.after(rows, 1e9).high_mm == pytest.approx(ErrorBand.of(np.full(3, 1.0 / 3.0)).high_mm, rel=0.01)
    assert PredictedError.of(covariance, asked, 1.0, 0.0).after(rows, 1e9).high_mm < 0.01


def test_the_number_of_rows_to_the_goal_is_the_least_that_meets_it(problem) -> None:
    covariance, asked, rows = problem
    error = PredictedError.of(covariance, asked, 0.0, 0.0)
    goal = error.after(rows, 3.0).high_mm
    count = error.rows_to(goal * 1.0001, rows, 500)
    assert count == 36
    assert error.rows_to(goal, rows, 20) is None
    assert error.rows_to(goal, rows[:0], 20) is None


@pytest.mark.parametrize(
    ("change", "end"),
    [
        ({}, None),
        ({"high_mm": 0.1}, "goal"),
        ({"high_mm": 0.1, "doubt": "the fit did not converge"}, None),
        ({"rows": 100}, "rows"),
        ({"high_mm": 0.1, "rows": 100}, "goal"),
        ({"next_seconds": 601.0}, "time"),
        ({"next_mm": 0.197}, "gain"),
        ({"next_mm": 0.197, "doubt": "too few"}, None),
    ],
)
def test_what_ends_a_campaign(change, end) -> None:
    assert ended_by(LIMITS, replace(GOING, **change)) == end


def test_without_a_limit_of_time_any_may_be_used() -> None:
    assert ended_by(replace(LIMITS, seconds=0.0), replace(GOING, next_seconds=1e6)) is None
