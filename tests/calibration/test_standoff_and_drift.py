"""Locating a sphere by a model, how surely the robot then stands off it, and drift seen at a reference touch."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import linregress

from cellctl.calibration import RobotModel, linear_drift, locate_sphere
from cellctl.formats import RobotFile
from cellctl.kinematics import inverse
from cellctl.planning import SphereTarget, plan_touches
from cellctl.planning.ways import Reach
from tests.helpers.arms import KR5_POSTURES

ROBOT = RobotFile.load(Path(__file__).parents[2] / "procedures" / "robots" / "kr5_r1400.yaml")
CENTRE, REACH, SIGMA = (850.0, 0.0, 550.0), 31.3, 0.02
MODEL = RobotModel(ROBOT.chain())


@pytest.fixture(scope="module")
def touched() -> np.ndarray:
    """Model angles (20, n) of the nominal robot exactly on the sphere."""
    low, high = ROBOT.limits().T.tolist()
    target = SphereTarget("P1", CENTRE, REACH - 10.0)  # a search begins 10 mm off what is said: on the surface
    touches = plan_touches(
        ROBOT.chain(), ROBOT.joint_map(), Reach(tuple(low), tuple(high)), KR5_POSTURES, [target], [20], 5
    )
    return ROBOT.joint_map().model([touch.start for touch in touches])


def test_a_sphere_is_located_where_it_is(touched) -> None:
    found = locate_sphere(MODEL, touched[:8], np.full(8, REACH), SIGMA)
    assert found.centre == pytest.approx(CENTRE, abs=1e-3)  # planned joints are rounded to 1e-4 deg
    assert np.abs(found.residuals).max() < 2e-3
    assert found.distances(touched[8:]) == pytest.approx(np.full(12, REACH), abs=5e-3)


def test_three_touches_locate_no_sphere(touched) -> None:
    with pytest.raises(ValueError, match="four"):
        locate_sphere(MODEL, touched[:3], np.full(3, REACH), SIGMA)


def test_four_touches_of_a_robot_that_is_far_off_locate_the_sphere_near_a_known_centre(touched) -> None:
    """From a campaign of a UR5e: these errors fit a sphere on the other side of the touches better."""
    normals = np.array([[-0.69, -0.71, 0.14], [-0.02, -0.62, 0.78], [-0.95, 0.29, 0.12], [0.04, 0.01, 1.0]])
    errors = [[4.2, 0.0, -0.1], [3.5, -1.2, 1.2], [5.0, -1.0, 2.3], [1.3, 3.4, -0.6]]
    poses = ROBOT.chain().forward(np.repeat(touched[:1], 4, axis=0))
    poses[:, :3, 3] = np.array(CENTRE) + REACH * normals / np.linalg.norm(normals, axis=1)[:, None] + errors
    reached = inverse(ROBOT.chain(), poses, np.repeat(touched[:1], 4, axis=0))
    assert reached.converged.all()
    alone = locate_sphere(MODEL, reached.q, np.full(4, REACH), SIGMA)
    assert np.linalg.norm(alone.centre - CENTRE) > REACH / 2
    near = locate_sphere(MODEL, reached.q, np.full(4, REACH), SIGMA, near=np.array(CENTRE))
    assert near.centre == pytest.approx(CENTRE, abs=6.0)


def covariance() -> np.ndarray:
    """A posterior with strong correlations: a few known directions in a loose prior."""
    names, turns = MODEL.names, MODEL.parameter_turns
    prior = np.where(turns, np.deg2rad(0.03), 0.3)
    prior[[index for index, name in enumerate(names) if name.startswith(("base_", "tool_"))]] = 0.0
    basis = np.random.default_rng(1).normal(size=(len(names), 10))
    known = np.linalg.qr(basis)[0]
    shape = np.eye(len(names)) - 0.95 * known @ known.T
    return prior[:, None] * shape * prior


@pytest.mark.long
def test_the_predicted_sigma_of_a_stand_off_is_the_scatter_over_robots_drawn_from_the_posterior(touched) -> None:
    spread = covariance()
    errors = []
    random = np.random.default_rng(2)
    located = locate_sphere(MODEL, touched[:8], np.full(8, REACH), SIGMA)
    targets = touched[8:]
    for deviations in random.multivariate_normal(np.zeros(len(spread)), spread, size=1500):
        true = MODEL.with_deviations(deviations)
        # the model touches a sphere that stands where the true robot puts it: distances change by the true robot's
        moved = true.tcp(touched[:8]) - MODEL.tcp(touched[:8])
        noise = random.normal(0.0, SIGMA, 8)
        seen = REACH + np.einsum("ij,ij->i", located.normals(touched[:8]), moved) + noise
        centre = _least_squares_centre(MODEL.tcp(touched[:8]), 2 * REACH - seen)
        # centre: by how much the model misplaces the sphere, mirrored; the true one is at CENTRE
        misplaced = np.array(CENTRE) - centre
        off = true.tcp(targets) - MODEL.tcp(targets)
        normals = located.normals(targets)
        errors.append(np.sum(normals * (off + misplaced), axis=1) + random.normal(0.0, SIGMA, len(targets)))
    found = np.std(errors, axis=0)
    predicted = located.sigma_of_stand_off(spread, targets)
    assert found == pytest.approx(predicted, rel=0.08)
    assert predicted.max() > 2.0 * SIGMA, "the model's own uncertainty has to show"


def _least_squares_centre(points: np.ndarray, distances: np.ndarray) -> np.ndarray:
    centre = np.array(CENTRE)
    for _ in range(20):
        away = points - centre
        length = np.linalg.norm(away, axis=1)
        centre = centre + np.linalg.lstsq(-away / length[:, None], distances - length, rcond=None)[0]
    return centre


def test_what_turns_or_lifts_the_whole_robot_does_not_count(touched) -> None:
    names = MODEL.names
    blind = np.zeros((len(names),) * 2)
    blind[names.index("theta1"), names.index("theta1")] = np.deg2rad(1.0) ** 2
    blind[names.index("d1"), names.index("d1")] = 10.0**2
    found = locate_sphere(MODEL, touched[:8], np.full(8, REACH), 1e-6)
    assert found.sigma_of_stand_off(blind, touched[8:]).max() < 1e-2


def test_more_touches_locate_more_surely(touched) -> None:
    none = np.zeros((len(MODEL.parameters),) * 2)
    few, many = (locate_sphere(MODEL, touched[:n], np.full(n, REACH), SIGMA) for n in (5, 16))
    target = touched[16:]
    assert (many.sigma_of_stand_off(none, target) < few.sigma_of_stand_off(none, target)).all()
    assert (many.sigma_of_stand_off(none, target) > SIGMA).all()


def test_the_drift_is_the_slope_of_a_straight_line() -> None:
    touch, shift = [0, 20, 41, 62, 83], [0.0, -0.11, -0.18, -0.33, -0.40]
    expected = linregress(touch, shift)
    found = linear_drift(touch, shift, 1e-6)
    assert found.mm_per_touch == pytest.approx(expected.slope)
    assert found.significant
    assert found.at([0, 10]) == pytest.approx([0.0, 10 * expected.slope])


def test_scatter_is_taken_for_drift_in_one_campaign_of_a_hundred_at_most() -> None:
    random = np.random.default_rng(3)
    touch = np.array([0, 20, 41, 62, 83])
    found = [linear_drift(touch, random.normal(0.0, 0.02, 5), 0.02) for _ in range(4000)]
    assert 0.003 < np.mean([one.significant for one in found]) < 0.015
    assert np.std([one.mm_per_touch for one in found]) == pytest.approx(np.mean([one.sigma for one in found]), rel=0.05)


def test_visits_that_scatter_far_more_than_known_make_the_slope_less_sure() -> None:
    quiet = linear_drift([0, 20, 40, 60], [0.0, 0.02, 0.04, 0.06], 0.01)
    outlying = linear_drift([0, 20, 40, 60], [0.2, -0.18, -0.16, 0.26], 0.01)
    assert quiet.mm_per_touch == pytest.approx(outlying.mm_per_touch)
    assert quiet.significant
    assert not outlying.significant
    assert outlying.sigma > 5 * quiet.sigma


@pytest.mark.parametrize("visits", [0, 1, 2])
def test_fewer_than_three_visits_show_no_drift(visits: int) -> None:
    assert not linear_drift(range(visits), [0.5] * visits, 0.01).significant
