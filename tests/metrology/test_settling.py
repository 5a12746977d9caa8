"""At rest or not: a warm-up that drifts, a vibration that decays, noise alone."""

from __future__ import annotations

import numpy as np
import pytest

from cellctl.metrology.instrument_checks import SettlingLimits, settling

LIMITS = SettlingLimits(samples=8, scatter_mm=0.03, drift_mm=0.05)


def warm_up(rng, minutes, sigma=0.005):
    """A return posture measured every minute while the arm grows by 0.4 mm with a time constant of 20 minutes."""
    growth = 0.4 * (1.0 - np.exp(-np.asarray(minutes) / 20.0))
    return growth[:, None] * np.array([0.6, 0.0, 0.8]) + sigma * rng.normal(size=(len(minutes), 3))


def test_a_robot_that_warms_up_is_settled_only_when_its_drift_is_below_the_limit():
    minutes = np.arange(120.0)
    xyz = warm_up(np.random.default_rng(1), minutes)
    first = next(n for n in range(8, 120) if settling(60.0 * minutes[:n], xyz[:n], LIMITS).settled)
    true_drift = 0.4 * (np.exp(-minutes[first - 8] / 20.0) - np.exp(-minutes[first - 1] / 20.0))
    assert true_drift < LIMITS.drift_mm
    assert 25 < first < 70
    assert settling(60.0 * minutes, xyz, LIMITS).settled


def test_noise_alone_is_seldom_said_to_drift_and_the_p_value_is_uniform():
    rng = np.random.default_rng(2)
    low = [settling(np.arange(8.0), 0.01 * rng.normal(size=(8, 3)), LIMITS).p_value < 0.05 for _ in range(1000)]
    assert 0.02 < np.mean(low) < 0.07


def test_a_drift_twice_the_limit_hardly_ever_passes():
    rng = np.random.default_rng(3)
    drift = np.linspace(0.0, 0.1, 8)[:, None] * [1.0, 0.0, 0.0]
    passed = [settling(np.arange(8.0), drift + 0.01 * rng.normal(size=(8, 3)), LIMITS).settled for _ in range(500)]
    assert np.mean(passed) < 0.01


def test_a_drift_just_at_the_limit_passes_no_more_often_than_the_confidence_allows():
    rng = np.random.default_rng(4)
    drift = np.linspace(0.0, LIMITS.drift_mm, 8)[:, None] * [0.0, 1.0, 0.0]
    passed = [settling(np.arange(8.0), drift + 0.01 * rng.normal(size=(8, 3)), LIMITS).settled for _ in range(1000)]
    assert np.mean(passed) < 0.07


def test_a_vibration_is_not_settled_and_says_so():
    samples = 0.2 * np.sin(np.arange(8.0) * 2.0)[:, None] * [0.0, 0.0, 1.0]
    found = settling(np.arange(8.0), samples, LIMITS)
    assert not found.settled
    assert "scatter" in found.reason


def test_too_few_samples_are_not_settled():
    assert not settling(np.arange(3.0), np.zeros((3, 3)), LIMITS).settled
    with pytest.raises(ValueError, match="at least 4"):
        settling(np.arange(3.0), np.zeros((3, 3)), SettlingLimits(samples=3))
