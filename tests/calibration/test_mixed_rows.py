"""One robot measured by tracker, on spheres, in sockets and by ball-bar: together better than by any of these alone."""

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cellctl.calibration import Session, Task, identify
from tests.helpers.honesty import task_of
from tests.helpers.own_campaigns import Campaign, certificate, nominal_of, shape_error
from tests.helpers.simulated_setups import SPHERES, poses

SOCKETS = np.array([[800.0, 200.0, 500.0], [900.0, -250.0, 350.0]])
ANCHOR = np.array([1300.0, -300.0, 100.0])
NAMES = ("S1", "S2", "S3", "P", "Q", "bar")
PLATE = [(0, 1), (1, 2), (0, 2)]
SIGMA = {"positions": 0.05, "touches": 0.03, "sockets": 0.03, "bar": 0.01}
SEEDS = range(12)
SPREAD = 3.0 / sqrt(2.0 * len(SEEDS) * 8.0)
"""3 σ of a ratio of RMS over as many robots, each of which errs in eight or more directions."""


def blocks_of(campaign, noisy=""):
    """Rows of all kinds; those of the kind `noisy` scatter ten times more than they say."""
    sigma = {kind: each * (10.0 if kind == noisy else 1.0) for kind, each in SIGMA.items()}
    blocks = {
        "positions": campaign.positions(30, sigma["positions"]),
        "touches": campaign.touches(36, SPHERES, sigma["touches"]),
        "sockets": campaign.sockets(24, SOCKETS, sigma["sockets"], first=3),
        "bar": campaign.distances(40, ANCHOR, sigma["bar"], 5),
    }
    return {kind: replace(rows, sigma=np.full_like(rows.sigma, SIGMA[kind])) for kind, rows in blocks.items()}


def identified(campaign, blocks, spacing):
    """All of the blocks in one fit; points that none of them knows are left out."""
    known = sorted({int(point) for rows in blocks for point in getattr(rows, "point", ())})
    at = [replace(r, point=np.searchsorted(known, r.point)) if hasattr(r, "point") else r for r in blocks]
    rough = np.full((len(known), 3), np.nan) if known else None
    plate = spacing if 0 in known else None
    return identify(Task(nominal_of(campaign.nominal), at, tuple(NAMES[k] for k in known), rough, plate))


@pytest.fixture(scope="module")
def errors():
    """True error and said σ (seeds, 2) of the robot's shape, by what it was measured with."""
    found = {}
    for seed in SEEDS:
        campaign = Campaign.of(seed)
        blocks, asked = blocks_of(campaign), campaign.asked()
        spacing = certificate(campaign.rng, SPHERES, PLATE, 0.01)
        sets = {**{kind: [rows] for kind, rows in blocks.items()}, "all": list(blocks.values())}
        for kind, rows in sets.items():
            done = identify_clean(campaign, rows, spacing)
            found.setdefault(kind, []).append(shape_error(done.identified, campaign.truth, asked))
    return {kind: np.array(each) for kind, each in found.items()}


def identify_clean(campaign, rows, spacing):
    done = identified(campaign, rows, spacing)
    assert done.identified.converged
    assert not done.outliers
    np.testing.assert_array_equal(done.noise, 1.0)
    return done


def rms(values):
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.long
def test_all_kinds_together_are_surer_than_the_best_of_them_for_every_robot(errors):
    alone = np.min([errors[kind][:, 1] for kind in SIGMA], axis=0)
    assert np.all(errors["all"][:, 1] < alone)


@pytest.mark.long
def test_all_kinds_together_find_the_robot_better_than_any_alone(errors):
    for kind in SIGMA:
        assert rms(errors["all"][:, 0]) < rms(errors[kind][:, 0])
        assert np.mean(errors["all"][:, 0] < errors[kind][:, 0]) > 0.5


@pytest.mark.parametrize("kind", [*SIGMA, "all"])
def test_the_error_of_the_shape_is_the_one_said_for_each_kind_and_for_all_together(errors, kind):
    true, said = errors[kind].T
    assert abs(rms(true) / rms(said) - 1.0) < SPREAD


@pytest.mark.long
@pytest.mark.parametrize("noisy", SIGMA)
def test_the_noise_of_one_kind_does_not_spoil_the_others(noisy):
    with_it, without = [], []
    for seed in range(3):
        campaign = Campaign.of(seed)
        blocks, asked = blocks_of(campaign, noisy), campaign.asked()
        spacing = certificate(campaign.rng, SPHERES, PLATE, 0.01)
        done = identified(campaign, list(blocks.values()), spacing)
        with_it.append(shape_error(done.identified, campaign.truth, asked)[0])
        rest = [rows for kind, rows in blocks.items() if kind != noisy]
        without.append(shape_error(identified(campaign, rest, spacing).identified, campaign.truth, asked)[0])
        np.testing.assert_array_equal(done.noise[numbers_of(blocks) != noisy], 1.0)
        if noisy in ("touches", "bar"):
            freedom = blocks[noisy].sigma.size - 10  # what of their numbers the others do not foresee, at the least
            np.testing.assert_allclose(done.noise[numbers_of(blocks) == noisy], 10.0, rtol=3.0 / sqrt(2.0 * freedom))
            assert not done.outliers
    assert rms(np.array(with_it)) < 1.15 * rms(np.array(without))


def numbers_of(blocks):
    """Of which kind each of the mixture's numbers is."""
    return np.array([kind for kind, rows in blocks.items() for _ in rows.quantities])


TEN = 10.0


def as_found(done, noisy, about=0.35):
    """Whether the numbers at `noisy` scatter ten times more than they say, by what was found, and no others."""
    np.testing.assert_allclose(done.noise[noisy], TEN, rtol=about)
    np.testing.assert_array_equal(done.noise[~noisy], 1.0)
    return not done.outliers and not done.n_inconsistent


@pytest.mark.parametrize("noisy", SIGMA)
@pytest.mark.parametrize("seed", [3, 11])
def test_one_noisy_kind_of_four_is_noisy_and_none_of_its_rows_is_wild(noisy, seed):
    campaign = Campaign.of(seed)
    blocks = blocks_of(campaign, noisy)
    done = identified(campaign, list(blocks.values()), certificate(campaign.rng, SPHERES, PLATE, 0.01))
    assert as_found(done, numbers_of(blocks) == noisy)


@pytest.mark.parametrize("seed", range(4))
def test_one_noisy_session_of_two_is_noisy_and_none_of_its_rows_is_wild(seed):
    campaign = Campaign.of(seed)
    blocks = [campaign.positions(40, 0.05), campaign.positions(30, TEN * 0.05, 0.05, session=1)]
    done = identify(Task(nominal_of(campaign.nominal), blocks, sessions=(Session(), Session("later"))))
    assert as_found(done, np.arange(6) >= 3)


@pytest.mark.parametrize("seed", range(4))
def test_poses_whose_turns_are_noisy_keep_their_places_as_good_as_promised(seed):
    draw = poses(seed)
    turns = Rotation.from_rotvec(np.random.default_rng(seed).normal(0.0, TEN * draw.rows.sigma_rad, (50, 3)))
    noisy = draw.rows.poses.copy()
    noisy[:, :3, :3] = turns.as_matrix() @ noisy[:, :3, :3]
    done = identify(task_of(replace(draw, rows=replace(draw.rows, poses=noisy))))
    assert as_found(done, np.arange(6) >= 3)
