"""The distributions are those of `scipy.stats`, which takes long to import."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from scipy import stats

from cellctl.calibration import distributions

X = np.concatenate([[0.0], np.geomspace(1e-6, 300.0, 60)])
P = np.concatenate([np.geomspace(1e-9, 0.5, 30), 1.0 - np.geomspace(1e-9, 0.5, 30)])
DOF = np.array([1, 2, 3, 6, 12, 100, 3000])[:, None]


@pytest.mark.parametrize(
    ("ours", "theirs"),
    [
        (distributions.chi2_sf(X, DOF), stats.chi2.sf(X, DOF)),
        (distributions.chi2_isf(P, DOF), stats.chi2.isf(P, DOF)),
        (distributions.chi2_ppf(P, DOF), stats.chi2.ppf(P, DOF)),
        (distributions.t_sf(np.concatenate([-X, X]), DOF), stats.t.sf(np.concatenate([-X, X]), DOF)),
        (distributions.t_ppf(P, DOF), stats.t.ppf(P, DOF)),
        (distributions.normal_sf(np.concatenate([-X, X])), stats.norm.sf(np.concatenate([-X, X]))),
        (distributions.normal_ppf(P), stats.norm.ppf(P)),
        (distributions.f_sf(X, DOF, 17), stats.f.sf(X, DOF, 17)),
        (distributions.f_isf(0.01, DOF, 17), stats.f.isf(0.01, DOF, 17)),
        (distributions.maxwell_cdf(X), stats.maxwell.cdf(X)),
    ],
    ids=["chi2 sf", "chi2 isf", "chi2 ppf", "t sf", "t ppf", "normal sf", "normal ppf", "F sf", "F isf", "Maxwell"],
)
def test_values_are_those_of_scipy_stats_to_the_last_digit(ours, theirs):
    np.testing.assert_array_equal(ours, theirs)


def test_the_binomial_is_that_of_scipy_stats_to_1e_10():
    trials = np.array([1, 7, 60, 900])[:, None]
    count = np.minimum(np.arange(0, 900, 13), trials)
    for p in (0.05, 0.5, 0.95):
        found, wanted = distributions.binomial_cdf(count, trials, p), stats.binom.cdf(count, trials, p)
        np.testing.assert_allclose(found, wanted, rtol=1e-10, atol=1e-300)


def test_without_degrees_of_freedom_a_limit_is_not_a_number_and_below_zero_everything_is_larger():
    assert np.isnan(distributions.chi2_isf(0.05, [0, 3])).tolist() == [True, False]
    assert np.isnan(distributions.t_ppf(0.975, [0, 3])).tolist() == [True, False]
    assert distributions.f_sf(-1e-12, 3, 7) == distributions.chi2_sf(-1e-12, 3) == 1.0


def test_the_identification_is_imported_without_what_takes_long():
    code = "import sys, cellctl.calibration; print(*(m for m in sys.modules if m.startswith('scipy.')))"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert not {"scipy.stats", "scipy.optimize", "scipy.spatial"} & set(loaded)
