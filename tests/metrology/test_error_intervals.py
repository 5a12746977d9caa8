"""95 % intervals of the figures of measured errors."""

from __future__ import annotations

import numpy as np
import pytest

from cellctl.metrology.error_figures import ErrorIntervals

COUNT, REPEATS = 80, 2000

Drawn = tuple[np.ndarray, list[ErrorIntervals]]


@pytest.fixture(scope="module")
def drawn() -> Drawn:
    errors = np.linalg.norm(np.random.default_rng(5).normal(0.0, 1.0, (REPEATS, COUNT, 3)), axis=2)
    return errors, [ErrorIntervals.of(each) for each in errors]


def test_intervals_hold_the_true_mean_and_rms_in_95_of_100_cases(drawn: Drawn) -> None:
    """Of 3-D normal errors: mean √(8/π), RMS √3."""
    for name, true in (("mean", np.sqrt(8.0 / np.pi)), ("rms", np.sqrt(3.0))):
        ends = np.array([getattr(each, name) for each in drawn[1]])
        share = np.mean((ends[:, 0] <= true) & (true <= ends[:, 1]))
        assert 0.93 < share < 0.97


def test_the_stated_share_of_further_errors_is_below_the_greatest_in_95_of_100_cases(drawn: Drawn) -> None:
    from scipy import stats

    errors, intervals = drawn
    covered = stats.maxwell.cdf(errors.max(axis=1)) >= intervals[0].share_below
    assert intervals[0].share_below == pytest.approx(0.963, abs=0.001)
    assert 0.935 < covered.mean() < 0.965


def test_a_single_error_has_no_interval() -> None:
    with pytest.raises(ValueError, match="two errors"):
        ErrorIntervals.of([0.1])
