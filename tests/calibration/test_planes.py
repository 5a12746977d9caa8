"""Touches on planes whose place nobody knows: what they identify, where they find the planes, what they cannot see."""

from dataclasses import replace

import numpy as np
import pytest

from cellctl.calibration import (
    PlaneRows,
    PoseRows,
    Split,
    State,
    Task,
    ToolDeflection,
    fit,
    identify,
    plane_estimates,
)
from cellctl.calibration.observability.other_postures import moved
from cellctl.calibration.rows.fixed_points import planes_of, pole_of
from cellctl.formats import RobotFile
from cellctl.planning.next_rows import rows_like
from cellctl.setup_check import check_setup
from tests.helpers.arms import KR5_FILE
from tests.helpers.own_campaigns import Campaign, certificate, nominal_of, shape_error

SLOPE = np.array([-0.6, 0.0, 0.8])
PLANES = np.array(
    [
        [1000.0, 0.0, 200.0, 0.0, 0.0, 1.0],
        [1300.0, 0.0, 450.0, -1.0, 0.0, 0.0],
        [950.0, -450.0, 450.0, 0.0, 1.0, 0.0],
    ]
)
CENTRES = np.array([[950.0, -350.0, 250.0], [950.0, 350.0, 250.0], [1150.0, 0.0, 400.0]])
BALL = 3.0
SIGMA = 0.03


def campaign_of(seed):
    """A robot whose base is the frame, as touches have it."""
    campaign = Campaign.of(seed)
    return replace(campaign, truth=replace(campaign.truth, base=np.eye(4)))


def task_of(campaign, blocks, names, spacing=None):
    return Task(nominal_of(campaign.nominal), blocks, names, np.full((len(names), 3), np.nan), spacing)


def all_in_fit(task):
    return Split(np.arange(len(task.rows)), ())


@pytest.mark.parametrize("offset", [0.0, 1e-3, 700.0, -700.0, 5000.0, -5000.0])
def test_a_plane_anywhere_the_origin_included_has_one_pole(offset):
    normal, back = planes_of(pole_of(SLOPE, offset)[None])
    np.testing.assert_allclose(normal[0], SLOPE, atol=1e-12)
    assert back[0] == pytest.approx(offset, abs=1e-8)


@pytest.mark.parametrize("offset", [0.0, 700.0, -1500.0])
def test_derivatives_are_those_of_differences(offset):
    rng = np.random.default_rng(3)
    model = nominal_of(Campaign.of(1).nominal).with_effects((ToolDeflection(0.41, 15.0),))
    poles = np.array([pole_of(SLOPE, offset), pole_of(-SLOPE, offset + 100.0)])
    rows = PlaneRows(rng.uniform(-1.5, 1.5, (5, 6)), np.array([0, 1, 1, 0, 1]), np.full(5, BALL), np.ones((5, 1)))
    at = rng.normal(0.0, np.where(model.parameter_turns, 0.01, 2.0))
    at[-1] = 0.004
    columns = rows.jacobian(State.alone(model.with_deviations(at), poles))

    def residual(index, step):
        deviations, places = at.copy(), poles.copy()
        (deviations if index < at.size else places.reshape(-1))[index - (0 if index < at.size else at.size)] += step
        return rows.residual(State.alone(model.with_deviations(deviations), places))

    for index in range(at.size + poles.size):
        step = 1e-5 if index < at.size and (model.parameter_turns[index] or index == at.size - 1) else 1e-2
        numeric = (residual(index, step) - residual(index, -step)) / (2.0 * step)
        np.testing.assert_allclose(columns[..., index], numeric, atol=1e-6 * max(1.0, np.abs(numeric).max()))


@pytest.fixture(scope="module")
def three_planes():
    """Robots on three planes, the third of them through the origin of the frame: campaign, task, identification."""
    found = []
    through_origin = PLANES.copy()
    through_origin[2, :3] -= 950.0 * np.array([0.0, -450.0 / 950.0, 0.0])  # y = 0
    for seed in range(4):
        campaign = campaign_of(seed)
        task = task_of(campaign, [campaign.planes(80, through_origin, SIGMA, BALL)], ("floor", "wall", "side"))
        found.append((campaign, task, identify(task)))
    return found, through_origin


def test_a_robot_that_touched_three_planes_is_as_far_off_as_it_says(three_planes):
    for campaign, task, done in three_planes[0]:
        asked = task.rows.q[::2]
        error, sigma = shape_error(done.identified, campaign.truth, asked)
        before = nominal_of(campaign.nominal).tcp(asked) - campaign.truth.points(asked)
        assert not done.outliers
        assert error < 0.6 * np.sqrt(np.mean(np.sum((before - before.mean(axis=0)) ** 2, axis=1)))
        assert 0.4 * sigma < error < 2.0 * sigma


def test_planes_are_found_where_they_are_on_the_side_of_the_robot(three_planes):
    found, planes = three_planes
    for _, task, done in found:
        for estimate, (*place, x, y, z) in zip(plane_estimates(task, done.identified), planes, strict=True):
            normal = np.array([x, y, z])
            # the heading and height of all planes together, which no touch sees, are θ1's and d1's tolerance
            assert np.rad2deg(np.arccos(min(estimate.normal @ normal, 1.0))) < 0.25
            assert abs(estimate.normal @ place - estimate.offset_mm) < 5.0
            assert 0.0 < estimate.sigma_mm < 3.0
            assert 0.0 < estimate.tilt_sigma_deg < 0.2


def test_planes_beside_spheres_of_certified_spacing_make_the_robot_better():
    errors = []
    for seed in range(3):
        campaign = campaign_of(seed)
        spacing = certificate(campaign.rng, CENTRES, [(0, 1), (0, 2), (1, 2)], 0.01)
        spheres, planes = campaign.touches(50, CENTRES, SIGMA), campaign.planes(50, PLANES, SIGMA, BALL, first=3)
        names, asked = ("S1", "S2", "S3", "floor", "wall", "side"), planes.q
        alone = identify(task_of(campaign, [spheres], names[:3], spacing)).identified
        both = identify(task_of(campaign, [spheres, planes], names, spacing)).identified
        errors.append([shape_error(found, campaign.truth, asked)[0] for found in (alone, both)])
    alone, both = np.sqrt(np.mean(np.square(errors), axis=0))
    assert both < 0.8 * alone


def test_a_held_out_plane_that_the_fit_never_touched_is_found_from_its_own_rows():
    campaign = campaign_of(5)
    task = task_of(campaign, [campaign.planes(96, PLANES, SIGMA, BALL)], ("floor", "wall", "side"))
    on_side = task.rows.only.point == 2
    result = fit(task, Split(np.flatnonzero(~on_side), ((np.flatnonzero(~on_side), np.flatnonzero(on_side)),)))
    assert result.n_test == 32
    assert result.test.rms < 0.5 * result.nominal.rms
    assert result.test.rms < 1.6 * result.predicted_test_rms


def test_too_few_touches_on_a_plane_prove_nothing():
    campaign = campaign_of(5)
    task = task_of(campaign, [campaign.planes(96, PLANES, SIGMA, BALL)], ("floor", "wall", "side"))
    point = task.rows.only.point
    used = np.sort(np.concatenate([np.flatnonzero(point < 2), np.flatnonzero(point == 2)[:3]]))
    test = np.flatnonzero(point == 2)[3:]
    assert "plane side has 3 touches in the fit, 4 at least" in fit(task, Split(used, ((used, test),))).verdict_reason


def test_what_planes_do_not_see_is_said_in_words():
    campaign = campaign_of(2)
    three = task_of(campaign, [campaign.planes(90, PLANES, SIGMA, BALL)], ("floor", "wall", "side"))
    hidden = fit(three, all_in_fit(three)).observability.hidden
    assert any("no row has a length in it" in each.reason for each in hidden)
    one = task_of(campaign, [campaign.planes(60, PLANES[:1], SIGMA, BALL)], ("floor",))
    reasons = [each.reason for each in fit(one, all_in_fit(one)).observability.hidden]
    assert "all rows are on one plane" in reasons


def test_rows_moved_elsewhere_and_rows_to_be_measured_touch_the_same_planes():
    campaign = campaign_of(2)
    block = campaign.planes(60, PLANES, SIGMA, BALL)
    task = task_of(campaign, [block], ("floor", "wall", "side"))
    state = identify(task).identified.state
    for joints in (np.ones(6, bool), np.arange(6) == 2):
        there = moved(block, state, joints, 0.3)
        assert len(there) > 10
        assert np.abs(there.residual(state)).max() < 0.2
        assert np.abs(there.q - block.q[: len(there)]).max() > 0.05
    limits = np.stack([block.q.min(axis=0) - 0.2, block.q.max(axis=0) + 0.2], axis=1)
    like = rows_like(block, state, limits, 64)
    assert len(like) > 10
    assert set(like.point) == {0, 1, 2}
    np.testing.assert_allclose(like.residual(state), 0.0, atol=1e-9)
    assert np.abs(like.reach - BALL).max() < 0.1


def test_a_reversed_joint_is_named_from_plane_touches_and_a_sound_set_up_is_not_accused():
    robot = RobotFile.load(KR5_FILE)
    campaign = campaign_of(1)
    block = campaign.planes(80, PLANES, SIGMA, BALL)
    task, joints = task_of(campaign, [block], ("floor", "wall", "side")), robot.joint_map()
    readings = joints.readings(block.q)
    sound = check_setup(task, joints, readings)
    assert not sound.implausible
    assert not sound.errors
    readings[:, 3] *= -1.0
    task = replace(task, rows=replace(block, at=joints.model(readings)))
    assert [mistake.words().partition(":")[0] for mistake in check_setup(task, joints, readings).errors] == [
        "A4 reversed"
    ]


def test_planes_are_no_poses():
    campaign = campaign_of(2)
    task = task_of(campaign, [campaign.planes(12, PLANES, SIGMA, BALL)], ("floor", "wall", "side"))
    assert task.n_registration == 9
    assert PoseRows not in task.rows.kinds
