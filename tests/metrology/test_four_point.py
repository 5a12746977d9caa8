"""The tool's tip by four poses at one point."""

from __future__ import annotations

import numpy as np
import pytest

from cellctl.kinematics import pose_from_xyz_abc
from cellctl.metrology.four_point import TooAlike, tool_point
from cellctl.metrology.measured_pose import nees, nees_range

TIP, PLACE = np.array([59.9, 50.5, 410.3]), np.array([1100.0, 200.0, 50.0])
ANGLES = np.array([[0, 0, 180], [0, 30, 180], [40, -20, 160], [-60, 10, 205], [20, -30, 190]], float)


def flanges(angles=ANGLES, rng=None, sigma=0.0):
    poses = pose_from_xyz_abc(np.zeros((len(angles), 3)), angles)
    poses[:, :3, 3] = PLACE - poses[:, :3, :3] @ TIP
    if rng is not None:
        poses[:, :3, 3] += sigma * rng.normal(size=(len(angles), 3))
    return poses


def test_exact_poses_give_tip_and_place_exactly():
    found = tool_point(flanges(ANGLES[:4]))
    assert np.allclose(found.tip, TIP, atol=1e-9)
    assert np.allclose(found.place, PLACE, atol=1e-9)


def test_the_stated_covariance_is_what_repeated_taking_shows():
    rng = np.random.default_rng(1)
    values = []
    for _ in range(500):
        found = tool_point(flanges(rng=rng, sigma=0.2), 0.2)
        values.append(nees(found.tip - TIP, found.covariance))
    assert nees_range(values, 3).consistent


def test_sigma_from_residuals_is_right_on_average():
    rng = np.random.default_rng(2)
    scatter = [tool_point(flanges(rng=rng, sigma=0.2)).scatter_mm for _ in range(500)]
    assert np.sqrt(np.mean(np.square(scatter))) == pytest.approx(0.2, rel=0.05)


@pytest.mark.parametrize(
    "angles",
    [[[0, 0, 180]] * 4, [[a, 0, 180] for a in (0, 30, 60, 90)], [[0, b, 180] for b in (0, 3, -3, 5)]],
    ids=["one orientation", "turned about the tool's axis alone", "tilted too little"],
)
def test_orientations_that_do_not_determine_the_tip_are_refused(angles):
    with pytest.raises(TooAlike, match="orientations differ too little"):
        tool_point(flanges(np.array(angles, float)))


def test_three_poses_are_too_few():
    with pytest.raises(TooAlike, match="at least 4"):
        tool_point(flanges(ANGLES[:3]))
