"""A joint turned alone: the circle's axis, radius and σ, and outliers among its points."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cellctl.metrology.axis_frames import NoCircle, fit_circle
from cellctl.metrology.measured_points import Points, beam_directions
from cellctl.metrology.measured_pose import nees_range

CENTRE, AXIS, RADIUS = np.array([2800.0, 400.0, 300.0]), np.array([0.2, -0.3, 0.93]), 700.0
AXIS = AXIS / np.linalg.norm(AXIS)


def on_circle(angles):
    x = np.cross([1.0, 0.0, 0.0], AXIS)
    start = RADIUS * x / np.linalg.norm(x)
    return CENTRE + Rotation.from_rotvec(np.asarray(angles)[:, None] * AXIS).apply(start)


def instrument(xyz, along=0.05, across=0.02, common=0.0):
    """Covariances (N, 3, 3) of a station: σ along the beam and across it, and a common range error."""
    beams = beam_directions(xyz)
    alone = beams @ np.diag([along**2, across**2, across**2]) @ np.swapaxes(beams, 1, 2)
    shared = beams @ np.diag([common**2, 0.0, 0.0]) @ np.swapaxes(beams, 1, 2)
    return alone + shared, shared


def noisy(rng, xyz, common=0.0):
    covariance, shared = instrument(xyz, common=common)
    joint = Points.of(xyz, covariance, shared).joint_covariance()
    return Points.of(xyz + rng.multivariate_normal(np.zeros(3 * len(xyz)), joint).reshape(-1, 3), covariance, shared)


ARC = np.radians(np.linspace(-60.0, 60.0, 13))


def test_points_on_a_circle_give_its_axis_and_radius_exactly():
    circle = fit_circle(Points.of(on_circle(ARC), 0.01), ARC)
    assert np.allclose(circle.centre, CENTRE, atol=1e-7)
    assert np.allclose(circle.direction, AXIS, atol=1e-10)
    assert circle.radius == pytest.approx(RADIUS, abs=1e-7)


def test_the_axis_is_right_handed_to_the_joints_angle_whatever_the_order_of_measuring():
    backwards = ARC[::-1]
    assert fit_circle(Points.of(on_circle(backwards), 0.01), backwards).direction @ AXIS > 0.99
    assert fit_circle(Points.of(on_circle(ARC), 0.01), -ARC).direction @ AXIS < -0.99


@pytest.mark.parametrize("common", [0.0, 0.2])
def test_stated_sigma_of_centre_axis_and_radius_is_what_repeated_measurements_show(common):
    rng = np.random.default_rng(1)
    true = np.concatenate([CENTRE, AXIS, [RADIUS]])
    values, chi2 = [], []
    for _ in range(200):
        circle = fit_circle(noisy(rng, on_circle(ARC), common), ARC)
        error = np.concatenate([circle.centre, circle.direction, [circle.radius]]) - true
        # the centre is free along the axis only as far as the points' mean height: all 6 numbers are determined
        values.append(error @ np.linalg.pinv(circle.covariance, rcond=1e-10, hermitian=True) @ error / 6.0)
        chi2.append(circle.chi2 / circle.dof)
    assert nees_range(values, 6).consistent
    assert nees_range(chi2, 2 * len(ARC) - 6).consistent


def test_the_gain_carries_small_changes_of_the_points_to_the_circle():
    rng = np.random.default_rng(2)
    points = noisy(rng, on_circle(ARC))
    change = rng.normal(size=(len(ARC), 3)) * 1e-4
    before, after = fit_circle(points, ARC), fit_circle(Points.of(points.xyz + change, points.covariance), ARC)
    moved = np.concatenate([after.centre, after.direction, [after.radius]])
    moved -= np.concatenate([before.centre, before.direction, [before.radius]])
    assert np.allclose(before.gain @ change.ravel(), moved, rtol=1e-3, atol=1e-7)


def test_outliers_are_flagged_and_do_not_move_the_circle():
    points = noisy(np.random.default_rng(3), on_circle(ARC))
    bad = points.xyz.copy()
    bad[4] += [0.0, 0.0, 1.0]
    bad[9] += [8.0, 0.0, 0.0]
    circle = fit_circle(Points.of(bad, points.covariance), ARC)
    assert np.flatnonzero(~circle.inliers).tolist() == [4, 9]
    assert np.linalg.norm(circle.centre - CENTRE) < 5.0 * circle.sigma_centre.max()
    assert not circle.gain.reshape(7, -1, 3)[:, [4, 9]].any()


def test_sound_points_are_seldom_flagged():
    rng = np.random.default_rng(4)
    flagged = sum(not fit_circle(noisy(rng, on_circle(ARC)), ARC).inliers.all() for _ in range(300))
    assert flagged <= 4


def test_points_that_determine_no_circle_are_refused_with_the_cure():
    with pytest.raises(NoCircle, match="at least 3"):
        fit_circle(Points.of(on_circle(ARC[:2]), 0.01))
    with pytest.raises(NoCircle, match="larger angle"):
        fit_circle(Points.of(on_circle(ARC[6:8].repeat(3)), 0.01))
