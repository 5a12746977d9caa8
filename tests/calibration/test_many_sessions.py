"""Many sessions, or a few touches beside many positions: what is noisy and what is wild is found, and soon."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from cellctl.calibration import RowBlocks, Session, State, Task, Tolerances, Unknowns, identify
from cellctl.calibration.identification.identify import sampled
from cellctl.calibration.selection.cross_validation import Linear
from tests.helpers.own_campaigns import Campaign, certificate, nominal_of, place
from tests.helpers.simulated_setups import SPHERES

SAID = 0.05
ROWS = 40


def sessions(seed, factors, outlying=()):
    """One robot at a new place for each of `factors`, by which its positions scatter more than stated; `outlying` rows
    of all are 1 mm off.
    """
    campaign, blocks = Campaign.of(seed), []
    for number, factor in enumerate(factors):
        moved = replace(campaign, truth=replace(campaign.truth, base=place(campaign.rng)))
        rows = moved.positions(ROWS, SAID * factor, SAID, number)
        mine = [row - number * ROWS for row in outlying if row // ROWS == number]
        rows.xyz[mine] += 1.0 / np.sqrt(3.0)
        blocks.append(rows)
    bases = [frozenset({"base"} if number else ()) for number in range(len(factors))]
    named = tuple(Session(str(number), base) for number, base in enumerate(bases))
    return Task(nominal_of(campaign.nominal), blocks, sessions=named)


@pytest.fixture
def looks(monkeypatch):
    """How often all rows are looked at, one by one, for what the others foresee of it."""
    seen, leave_one_out_chi2 = [], Linear.leave_one_out_chi2

    def counted(linear, kept):
        seen.append(len(kept))
        return leave_one_out_chi2(linear, kept)

    monkeypatch.setattr(Linear, "leave_one_out_chi2", counted)
    return seen


def test_noisy_sessions_are_found_with_a_few_looks_for_each(looks):
    factors = np.array([1.0, 3.0] * 4)
    found = identify(sessions(5, factors))
    assert found.outliers == ()
    assert found.n_inconsistent == 0
    np.testing.assert_allclose(found.noise[::3], factors, rtol=0.25)
    assert len(looks) < 20 * len(factors)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_wild_rows_of_a_good_session_stay_wild_beside_noisy_sessions(seed):
    outlying = (83, 101)
    found = identify(sessions(seed, [1.0, 3.0, 1.0, 5.0], outlying))
    assert found.outliers == outlying
    np.testing.assert_allclose(found.noise[::3], [1.0, 3.0, 1.0, 5.0], rtol=0.25)


def linear_of(task):
    unknowns = Unknowns.of(State.alone(task.model, task.rough), task.points, Tolerances(flat_mm=1e4, flat_rad=10.0))
    return Linear.about(unknowns, np.zeros(len(unknowns.names)), task.rows, [])


def test_how_much_each_kind_scatters_is_told_without_its_wild_rows():
    campaign, rng = Campaign.of(4), np.random.default_rng(4)
    blocks = [campaign.positions(60, SAID), campaign.positions(60, SAID)]
    noise = np.array([1.0, 1.0, 1.0, 3.0])  # three coordinates are one kind, and share the first one's factor
    linear = linear_of(Task(nominal_of(campaign.nominal), blocks))
    linear = replace(linear, residual=rng.normal(size=(120, 3)) * np.repeat([1.0, 3.0], 60)[:, None])
    linear.residual[[7, 30]] += 20.0
    scatter = noise * linear.noisier(noise).scatter(~np.isin(np.arange(120), [7, 30]))
    np.testing.assert_allclose(scatter, noise, rtol=0.25)


def test_what_noisier_rows_tell_of_the_model_is_that_of_rows_with_wider_sigma():
    task = sessions(6, [1.0])
    halves = RowBlocks((task.rows.pick(slice(0, 15)).only, task.rows.pick(slice(15, 40)).only))
    linear, noise = linear_of(replace(task, rows=halves)), np.repeat([2.0, 7.0], 3)
    wider = linear.noisier(noise)
    lines = wider.jacobian.reshape(-1, wider.jacobian.shape[-1])
    expected = 0.5 * np.linalg.slogdet(wider.known + lines.T @ lines)[1]
    assert linear.half_log_det(noise) == pytest.approx(expected, rel=1e-9)


def beside_positions(count, outlying=()):
    """36 touches of which some are 5 mm off, after `count` positions."""
    campaign = Campaign.of(9)
    touches = campaign.touches(36, SPHERES, SAID)
    touches.reach[list(outlying)] += 5.0
    plate = certificate(campaign.rng, SPHERES, [(0, 1), (0, 2), (1, 2)], 0.01)
    rows = [campaign.positions(count, SAID), touches]
    return Task(nominal_of(campaign.nominal), rows, ("S1", "S2", "S3"), np.full((3, 3), np.nan), plate)


def test_wild_touches_are_found_beside_any_number_of_positions(monkeypatch):
    monkeypatch.setattr(sys.modules["cellctl.calibration.identification.identify"], "SEARCHED", 200)
    found = identify(beside_positions(2000, outlying=(4, 17)))
    assert found.outliers == (2004, 2017)
    assert found.n_inconsistent == 0
    assert found.noise.tolist() == [1.0] * 4


def test_a_sample_has_small_blocks_and_rare_points_whole():
    task = beside_positions(500)
    touches = replace(task.rows.blocks[1], point=np.array([0] * 3 + [1] * 10 + [2] * 23))
    rows = RowBlocks((task.rows.blocks[0], touches))
    enough = sampled(rows, 100)
    assert len(enough) == 100
    assert (np.diff(enough) > 0).all()
    assert set(range(500, 536)) <= set(enough.tolist())
    few = sampled(rows, 44)
    assert len(few) == 44
    assert np.count_nonzero(few < 500) == 22
    assert np.bincount(touches.point[few[few >= 500] - 500]).tolist() == [3, 9, 10]
    assert sampled(rows, 1000).tolist() == list(range(536))
