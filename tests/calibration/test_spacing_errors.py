"""A certified distance that contradicts the rows is named with figures; one that is right, or unknown, is not."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from cellctl.calibration import SpacingRows, Task, identify
from cellctl.setup_check import find_spacing_errors
from cellctl.setup_check._predicted_spacings import model_errors
from tests.helpers.own_campaigns import Campaign, certificate, nominal_of


def with_spacings(task, by):
    """The task with its certified distances S1–S2, S1–S3, S2–S3 wrong by `by` (3,), mm."""
    return replace(task, spacings=replace(task.spacings, mm=task.spacings.mm + np.array(by, float)))


@pytest.mark.parametrize("by", [100.0, -20.0, 1.0])
def test_a_wrong_distance_is_named_with_what_is_given_and_what_the_rows_estimate(touches, touch_task, by):
    task = with_spacings(touch_task(touches), [0.0, by, 0.0])
    (contradicted,) = find_spacing_errors(task)
    true = np.linalg.norm(touches.centres[0] - touches.centres[2])
    assert contradicted.between == ("S1", "S3")
    assert contradicted.certain
    assert abs(contradicted.estimate - true) < 4.0 * contradicted.sigma < 0.5
    assert contradicted.what.startswith(
        f"spacing S1–S3: {contradicted.given:g} mm given, {contradicted.estimate:.1f}"[:-2]
    )


def test_two_wrong_distances_are_both_named_and_the_right_one_is_not(touches, touch_task):
    contradicted = find_spacing_errors(with_spacings(touch_task(touches), [30.0, -20.0, 0.0]))
    assert [each.between for each in contradicted] == [("S1", "S2"), ("S1", "S3")]
    assert all(each.certain for each in contradicted)


def test_of_two_distances_between_the_same_points_the_rows_show_the_right_one(touches, touch_task):
    task = touch_task(touches)
    right = task.spacings.mm[0]
    twice = SpacingRows(np.array([[0, 1], [0, 1]]), np.array([right, right + 5.0]), np.full((2, 1), 0.01))
    (contradicted,) = find_spacing_errors(replace(task, spacings=twice))
    assert contradicted.given == right + 5.0


@pytest.mark.long
def test_distances_that_are_right_are_never_named(draw, touch_task):
    for seed in range(4):
        drawn = draw(seed, 24 + 12 * (seed % 4))
        if seed % 3 == 0:
            drawn.readings[:3] += np.random.default_rng(seed).normal(0.0, 1.0, (3, 6))
        assert find_spacing_errors(touch_task(drawn)) == ()


def test_touches_that_do_not_check_each_other_judge_a_distance_by_a_wider_prior(draw, touch_task):
    task = touch_task(draw(0, 22))
    assert find_spacing_errors(with_spacings(task, [0.0, 1.0, 0.0])) == ()
    (contradicted,) = find_spacing_errors(with_spacings(task, [0.0, 100.0, 0.0]))
    assert contradicted.between == ("S1", "S3")
    assert contradicted.least > 2.0


SOCKETS = np.array([[800.0, 300.0, 500.0], [1000.0, -300.0, 350.0], [1100.0, 100.0, 250.0]])


def sockets(by):
    """60 visits to three sockets, and two certified distances wrong by `by` (2,), mm: nothing else knows a length."""
    campaign = Campaign.of(3)
    at_home = replace(campaign, truth=replace(campaign.truth, base=np.eye(4)))
    certified = certificate(campaign.rng, SOCKETS, [(0, 1), (0, 2)], 0.01)
    wrong = replace(certified, mm=certified.mm + np.array(by))
    names = ("P", "Q", "R")
    rows = [at_home.sockets(60, SOCKETS, 0.03)]
    return Task(nominal_of(campaign.nominal), rows, names, np.full((3, 3), np.nan), wrong)


def test_sockets_contradict_what_no_robot_of_its_make_reaches_and_of_less_show_only_that_two_distances_disagree():
    assert find_spacing_errors(sockets([0.0, 0.0])) == ()
    (contradicted,) = find_spacing_errors(sockets([50.0, 0.0]))
    assert (contradicted.between, contradicted.certain) == (("P", "Q"), True)
    told = find_spacing_errors(sockets([0.6, 0.0]))
    assert [each.between for each in told] == [("P", "Q"), ("P", "R")]
    assert not any(each.certain for each in told)


def test_all_sizes_wrong_by_as_little_as_the_robot_may_be_are_let_pass():
    certified = sockets([0.0, 0.0]).spacings.mm
    assert find_spacing_errors(sockets(0.0003 * certified)) == ()


def beside_an_instrument(seed, positions, each, by=0.0):
    """Positions, so many touches on each of three spheres, and their distances certified, the first off by `by` mm."""
    campaign = Campaign.of(seed)
    centres = np.array([1000.0, 0.0, 400.0]) + campaign.rng.uniform(-250.0, 250.0, (3, 3))
    rows = [campaign.positions(positions, 0.05), campaign.touches(3 * each, centres, 0.05)]
    certified = certificate(campaign.rng, centres, [(0, 1), (0, 2), (1, 2)], 0.01)
    certified = replace(certified, mm=certified.mm + np.array([by, 0.0, 0.0]))
    return Task(nominal_of(campaign.nominal), rows, ("S0", "S1", "S2"), np.full((3, 3), np.nan), certified)


@pytest.mark.parametrize("each", [3, 4, 5])
def test_spheres_with_few_touches_name_no_distance_that_is_right(each):
    assert [seed for seed in range(4) if find_spacing_errors(beside_an_instrument(seed, 100, each))] == []


def test_thousands_of_positions_do_not_crowd_out_the_touches():
    assert find_spacing_errors(beside_an_instrument(9, 5000, 12)) == ()
    (contradicted,) = find_spacing_errors(beside_an_instrument(9, 5000, 12, by=50.0))
    assert contradicted.between == ("S0", "S1")
    assert abs(contradicted.given - 50.0 - contradicted.estimate) < 4.0 * contradicted.sigma < 2.0


def all_between(spheres):
    """Six touches on each of so many spheres, every distance between them certified."""
    campaign = Campaign.of(8)
    centres = np.array([1000.0, 0.0, 400.0]) + campaign.rng.uniform(-250.0, 250.0, (spheres, 3))
    rows = campaign.touches(6 * spheres, centres, 0.05)
    certified = certificate(campaign.rng, centres, list(combinations(range(spheres), 2)), 0.01)
    names = tuple(f"S{index}" for index in range(spheres))
    return Task(nominal_of(campaign.nominal), rows, names, np.full((spheres, 3), np.nan), certified)


@pytest.mark.parametrize(("spheres", "factor"), [(8, 1.005), (16, 1 / 25.4), (16, 1.005)])
def test_distances_wrong_by_one_factor_are_found_by_that_factor(spheres, factor):
    task = all_between(spheres)
    wrong = replace(task.spacings, mm=task.spacings.mm * factor)
    (contradicted,) = find_spacing_errors(replace(task, spacings=wrong))
    assert abs(contradicted.factor - 1.0 / factor) < 4.0 * contradicted.sigma < 0.003 / factor
    assert contradicted.what.startswith(f"all {contradicted.count} spacings that can be checked: × ")


@pytest.mark.long
def test_a_sphere_whose_touches_fit_two_centres_is_not_used():
    """Alone, these rows put S8 13 mm from where it is."""
    task = all_between(16)
    assert find_spacing_errors(task) == ()
    off = np.where(np.arange(len(task.spacings)) == 1, 2.0, 0.0)
    (contradicted,) = find_spacing_errors(replace(task, spacings=replace(task.spacings, mm=task.spacings.mm + off)))
    assert contradicted.between == ("S0", "S2")
    assert abs(contradicted.given - 2.0 - contradicted.estimate) < 4.0 * contradicted.sigma < 2.0


def ten_sockets():
    """A robot identified from visits of ten sockets, five plates of two, with nothing that the model lacks."""
    campaign = Campaign.of(3)
    at_home = replace(campaign, truth=replace(campaign.truth, base=np.eye(4)))
    places = np.array([900.0, 0.0, 400.0]) + campaign.rng.uniform(-200.0, 200.0, (10, 3))
    rows = [at_home.sockets(120, places, 0.03)]
    task = Task(nominal_of(campaign.nominal), rows, tuple("ABCDEFGHIJ"), np.full((10, 3), np.nan))
    found = identify(task)
    pairs = np.arange(10).reshape(5, 2)
    true = np.linalg.norm(places[pairs[:, 0]] - places[pairs[:, 1]], axis=1)
    return found, task.rows.pick(np.array(found.used)), SpacingRows(pairs, true, np.full((5, 1), 0.01))


def test_only_five_estimates_of_one_distance_show_what_the_model_lacks_by_their_scatter():
    found, rows, spacings = ten_sockets()
    clean = np.sqrt(np.diag(model_errors(spacings, found.identified, rows, found.noise)))
    assert clean.max() < 0.05
    alike = replace(spacings, mm=np.full(5, spacings.mm.mean()))
    scatter = np.sqrt(np.diag(model_errors(alike, found.identified, rows, found.noise)))
    np.testing.assert_allclose(scatter, np.std(spacings.mm, ddof=1), rtol=0.02)
    four = np.sqrt(np.diag(model_errors(alike.pick(np.arange(4)), found.identified, rows, found.noise)))
    np.testing.assert_allclose(four, clean[:4], rtol=1e-6)
