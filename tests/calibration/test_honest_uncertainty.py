"""The estimator's own σ is the error that is found: 20 seeds of the study `honest_uncertainty`.

Truth, measurements and the optimum to compare with come from an arm, a posterior and derivatives written for tests
(`own_model`), not from cellctl.
"""

from dataclasses import replace

import numpy as np
import pytest

from cellctl.calibration import RowBlocks, identify
from tests.helpers.honesty import Summary, elsewhere, fitted, honesty, observed, task_of
from tests.helpers.simulated_setups import OUTSIDE, SETUPS, TILTED, UPRIGHT, fixed

SEEDS = 20
FEWEST_INSIDE = 16 / SEEDS
"""Of 20 draws that lie inside by 95 % each, fewer than 16 do once in 380 times."""


@pytest.fixture(scope="module", params=SETUPS)
def summary(request):
    return Summary.of([honesty(SETUPS[request.param](seed)) for seed in range(SEEDS)])


@pytest.mark.long
def test_covariance_is_as_large_as_the_errors_squared(summary):
    """Four standard deviations of the mean of 20 draws; σ 10 % too small or too large for all parameters shows."""
    assert summary.nees == pytest.approx(1.0, abs=0.2)
    assert summary.place_nees == pytest.approx(1.0, abs=0.4)


@pytest.mark.long
def test_truth_lies_in_the_95_percent_regions(summary):
    assert summary.coverage >= FEWEST_INSIDE
    assert summary.place_coverage >= FEWEST_INSIDE
    assert summary.volume_coverage >= FEWEST_INSIDE


@pytest.mark.long
def test_no_worse_than_scipys_optimum_of_the_same_posterior(summary):
    """The bend is worked out on the nominal arm, the test's own on the true one: a quarter σ at most."""
    assert summary.ratio <= 1.02
    assert summary.off_scipy < 0.25


@pytest.mark.long
def test_clean_rows_are_neither_left_out_nor_called_noisy(summary):
    assert summary.left_out_per_1000 == 0.0
    assert summary.grown == summary.prior_scale == 0
    assert summary.unconverged == 0


@pytest.mark.parametrize("setup", SETUPS)
def test_predict_says_what_parameters_and_covariance_say(setup):
    """Points and σ against the own arm at the same parameters, and its derivatives by differences."""
    draw = SETUPS[setup](0)
    fit = fitted(draw)
    points, sigma = fit.predicted(draw.asked)
    columns = fit.unknown.columns(fit.found, draw.asked)
    expected = np.sqrt(np.einsum("nkp,pq,nkq->n", columns, fit.covariance, columns))
    np.testing.assert_allclose(points, fit.unknown.arm(fit.found).points(draw.asked), atol=0.002)
    np.testing.assert_allclose(sigma, expected, rtol=0.01)


LOST_ZEROS, OTHER_LINKS = OUTSIDE
LOOSENED = {LOST_ZEROS: ("zeros", 8.0), OTHER_LINKS: ("links", 1.5)}


@pytest.mark.parametrize("what", OUTSIDE)
@pytest.mark.parametrize("setup", SETUPS)
def test_a_truth_outside_the_tolerances_is_found_all_the_same_and_said(setup, what):
    """20 and 6 σ of the prior away: it is not taken for noise, and σ said is not far below the error."""
    all_of = [honesty(SETUPS[setup](seed, OUTSIDE[what]), compared=False) for seed in range(2)]
    found, (group, least) = Summary.of(all_of), LOOSENED[what]
    assert found.unconverged == 0
    assert max(one.growth for one in all_of) < 1.3
    assert min(one.strangest for one in all_of) > 4.0
    assert all(one.prior_scale.get(group, 1.0) > least for one in all_of)
    assert found.rms < 1.4 * found.said
    assert found.nees < 1.3


ONE_ORIENTATION, TWO_ORIENTATIONS = [UPRIGHT], [UPRIGHT, TILTED]


@pytest.mark.long
@pytest.mark.parametrize("turns", [ONE_ORIENTATION, TWO_ORIENTATIONS], ids=["one", "two"])
def test_few_orientations_predict_right_where_they_were_and_say_so_elsewhere(turns):
    pairs = [elsewhere(*fixed(seed, turns)) for seed in range(3)]
    same, others = (list(side) for side in zip(*pairs, strict=True))
    assert max(one.rms for one in same) < 0.05
    assert np.mean([one.nees for one in same]) < 1.6
    assert sum(one.inside for one in same) >= 2
    assert min(one.said_rms for one in others) > 5.0
    assert np.mean([one.nees for one in others]) < 3.0


@pytest.mark.long
@pytest.mark.parametrize("turns", [ONE_ORIENTATION, TWO_ORIENTATIONS], ids=["one", "two"])
def test_few_orientations_leave_tool_and_base_untold_apart_and_it_is_said(turns):
    """In one orientation all three directions of the tool are the base's as well; in two, that of the turn's axis."""
    for seed in range(2):
        draw, _ = fixed(seed, turns)
        told = observed(draw)
        together = [words for words in told.unseen if "tool translation" in words and "base translation" in words]
        letters = {letter for words in together for letter in words.partition("tool translation along ")[2][:7]}
        assert fitted(draw).converged
        assert {"X", "Y", "Z"} <= letters if turns is ONE_ORIENTATION else together
        reason = next(hidden.reason for hidden in told.hidden if not hidden.harmless)
        one = "orientation never changes in these rows"
        assert reason == (one if turns is ONE_ORIENTATION else "orientation changes about one axis only")


def test_what_stays_where_it_starts_does_not_explain_residuals_that_are_left():
    """One orientation, joints as a controller writes them; the rows are off as if the tool were 3 m off, and the base
    with it. The fit does not go there, as no row can tell that from its noise; so what is left of the rows that belong
    together has to be noise.
    """
    task = task_of(fixed(0, ONE_ORIENTATION)[0])
    rows = task.rows.only
    rounded = replace(rows, at=np.radians(np.round(np.degrees(rows.q), 2)))
    found = identify(replace(task, rows=RowBlocks.of(rounded))).identified
    unseen = found.unknowns.pinned[0] * found.unknowns.sigma
    wrong = replace(rounded, xyz=rounded.xyz + 3.0 * rounded.jacobian(found.state) @ unseen)
    done = identify(replace(task, rows=RowBlocks.of(wrong)))
    used = wrong.pick(list(done.used))
    left = used.residual(done.identified.state) / used.sigma
    assert np.sqrt(np.mean(left**2)) < 1.1 * done.noise.max()
