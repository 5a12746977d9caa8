"""Ratios to the floor, and the floor's own figures as the methods state them."""

from __future__ import annotations

import numpy as np
import pytest

from cellctl.metrology.error_figures import expected_floor, floor_ratio


def test_mean_and_maximum_of_the_floor_are_those_of_the_methods():
    """0.03 mm 3-D RMS, 80 rows: mean 0.028, expected maximum 0.060."""
    mean, largest = expected_floor(0.03, 80)
    assert mean == pytest.approx(0.028, abs=0.0005)
    assert largest == pytest.approx(0.060, abs=0.001)


def test_the_ratio_is_of_root_mean_squares():
    found = floor_ratio([0.3, 0.4], [0.1, 0.2])
    assert found.ratio == pytest.approx(np.sqrt(0.25 / 0.05))
    assert found.rms_mm == pytest.approx(np.sqrt(0.125))


def test_the_interval_holds_the_true_ratio_in_95_percent_of_runs():
    """A model with an error of its own besides the noise: true ratio √(1 + 0.5²)."""
    rng = np.random.default_rng(1)
    inside = 0
    for _ in range(600):
        noise = rng.normal(size=(80, 3))
        errors = np.linalg.norm(noise + 0.5 * rng.normal(size=(80, 3)), axis=1)
        found = floor_ratio(errors, np.linalg.norm(noise, axis=1))
        inside += found.low <= np.sqrt(1.25) <= found.high
    assert 0.92 <= inside / 600 <= 0.975


def test_errors_that_are_not_paired_are_refused():
    with pytest.raises(ValueError, match="same two or more rows"):
        floor_ratio([0.1, 0.2], [0.1])
