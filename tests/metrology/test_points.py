"""The joint covariance of points with a common part."""

from __future__ import annotations

import numpy as np
import pytest

from cellctl.metrology.measured_points import Points, beam_directions

XYZ = np.array([[3000.0, 0.0, 0.0], [0.0, 2000.0, 300.0], [-1500.0, -700.0, -900.0]])
BEAMS = beam_directions(XYZ)


def along(sigma):
    return BEAMS @ np.diag([sigma**2, 0.0, 0.0]) @ np.swapaxes(BEAMS, 1, 2)


def test_a_common_range_error_moves_all_points_along_their_own_beams_by_the_same_amount():
    joint = Points.of(XYZ, along(0.2) + 1e-6 * np.eye(3), along(0.2)).joint_covariance()
    values, vectors = np.linalg.eigh(joint)
    assert values[-1] == pytest.approx(3 * 0.04, rel=1e-3)
    assert values[-2] < 1e-5
    assert np.allclose(np.abs(vectors[:, -1]), np.abs(BEAMS[..., 0].ravel()) / np.sqrt(3.0), atol=1e-3)
    assert np.allclose(Points.of(XYZ, along(0.2), along(0.2)).range_sigma, 0.2)


def test_each_point_keeps_its_whole_covariance():
    whole = along(0.2) + np.array([[0.01, 0.002, 0.0], [0.002, 0.02, 0.0], [0.0, 0.0, 0.01]])
    joint = Points.of(XYZ, whole, along(0.2)).joint_covariance()
    for place in range(3):
        block = joint[3 * place : 3 * place + 3, 3 * place : 3 * place + 3]
        assert np.allclose(block, whole[place], atol=1e-8)


def test_the_mean_of_many_points_keeps_the_common_part():
    """100 points in one direction: the mean's σ along the beam is 0.2 (common), not 0.22 / 10."""
    xyz = np.tile([3000.0, 0.0, 0.0], (100, 1))
    common = np.diag([0.04, 0.0, 0.0])
    joint = Points.of(xyz, common + 0.01 * np.eye(3), common).joint_covariance()
    mean = np.kron(np.full((1, 100), 0.01), np.eye(3))
    assert np.sqrt(np.diag(mean @ joint @ mean.T)) == pytest.approx([np.sqrt(0.04 + 1e-4), 0.01, 0.01], rel=1e-3)


@pytest.mark.parametrize("common", [0.2, np.diag([0.5, 0.0, 0.0])])
def test_a_common_part_larger_than_the_whole_is_refused(common):
    with pytest.raises(ValueError, match="larger than the covariance"):
        Points.of(XYZ, 0.1, common)
