"""Inverse kinematics: closes on reachable poses, says so when a pose cannot be reached."""

import numpy as np
import pytest

from cellctl.kinematics import Link, SerialChain, inverse, pose_from_xyz_abc
from tests.helpers.arms import KR5_LINKS


@pytest.fixture
def chain():
    return SerialChain.from_links("mdh-hayati", KR5_LINKS, None, pose_from_xyz_abc([60, 50, 410], [39, 4, 0]))


def test_a_batch_closes_on_its_poses_from_a_warm_start(chain):
    rng = np.random.default_rng(3)
    q = np.deg2rad([0, -60, 60, 10, 50, 0]) + rng.uniform(-0.4, 0.4, (40, 5, 6))
    result = inverse(chain, chain.forward(q), q + rng.uniform(-0.05, 0.05, q.shape))
    assert result.converged.all()
    assert result.error_mm.max() < 1e-9
    np.testing.assert_allclose(result.q, q, atol=1e-8)


def test_one_start_serves_many_poses(chain):
    rng = np.random.default_rng(4)
    start = np.deg2rad([0, -60, 60, 10, 50, 0])
    poses = chain.forward(start + rng.uniform(-0.3, 0.3, (50, 6)))
    result = inverse(chain, poses, start)
    assert result.converged.mean() > 0.95
    found = chain.forward(result.q[result.converged])
    np.testing.assert_allclose(found, poses[result.converged], atol=1e-8)


def test_a_tool_turned_by_exactly_half_a_turn_is_not_taken_for_one_in_place(chain):
    start = np.deg2rad([0, -60, 60, 10, 50, 0.0])
    turned = start + np.array([0, 0, 0, 0, 0, np.pi])
    result = inverse(chain, chain.forward(turned), start)
    assert bool(result.converged)
    np.testing.assert_allclose(chain.forward(result.q), chain.forward(turned), atol=1e-8)


def test_a_pose_out_of_reach_is_reported_and_its_neighbours_still_close(chain):
    q = np.tile(np.deg2rad([0, -60, 60, 10, 50, 0.0]), (2, 1))
    poses = chain.forward(q)
    poses[1, :3, 3] = [5000, 0, 0]
    result = inverse(chain, poses, q + 0.01)
    assert result.converged.tolist() == [True, False]
    assert result.error_mm[1] > 1000
    assert np.isfinite(result.q).all()


def test_a_single_pose_needs_no_batch_axis(chain):
    q = np.deg2rad([5, -70, 60, 10, 40, 0.0])
    result = inverse(chain, chain.forward(q), q + 0.02)
    assert result.q.shape == (6,)
    assert bool(result.converged)


def test_seven_joints_close_too():
    links = [
        Link(0, d, 0, alpha)
        for d, alpha in zip([360, 0, 420, 0, 400, 0, 126], np.deg2rad([-90, 90, 90, -90, -90, 90, 0]), strict=True)
    ]
    chain = SerialChain.from_links("mdh-hayati", links)
    q = np.deg2rad([10, 40, -20, -60, 30, 50, 5.0])
    result = inverse(chain, chain.forward(q), q + 0.05)
    assert bool(result.converged)
