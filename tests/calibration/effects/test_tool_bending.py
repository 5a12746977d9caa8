"""A cantilever integrated here from its curvature, against the tool's one amount."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cellctl.calibration.effects import ToolDeflection
from cellctl.calibration.model.postures import Postures

LENGTH_M, LOAD_N, STIFFNESS = 0.41, 15.0, 500.0  # E·I, N m²


def integrated_tip_mm(across_n):
    """Tip shift of a cantilever: curvature M/(E·I) with M = F (l − s), integrated twice by midpoints."""
    steps = 20_000
    s = (np.arange(steps) + 0.5) / steps * LENGTH_M
    slope = np.cumsum(across_n * (LENGTH_M - s) / STIFFNESS) * LENGTH_M / steps
    return 1000.0 * slope.sum() * LENGTH_M / steps


def test_a_tool_bends_as_a_beam_does_whichever_way_it_points(arm, rng):
    chain, q = arm.chain(), rng.uniform(-np.pi, np.pi, (10, arm.n))
    shift = ToolDeflection(LENGTH_M, LOAD_N).shifts(chain, Postures(q))[..., 0] / STIFFNESS
    weight = np.array([0.0, 0.0, -LOAD_N])
    for axis, found in zip(arm.directed(q, arm.n - 1, arm.flange[:3, 2]), shift, strict=True):
        across = weight - (weight @ axis) * axis
        expected = integrated_tip_mm(np.linalg.norm(across)) * across / np.linalg.norm(across)
        assert_allclose(found, expected, atol=1e-4 * np.linalg.norm(expected))


def test_a_hanging_tool_does_not_bend(six_joints):
    chain = six_joints.chain()
    hanging = np.array([[0.3, 0.0, 0.0, 0.0, np.pi / 2, 0.2]])
    assert_allclose(chain.forward_flange(hanging)[0, :3, 2], [0, 0, -1], atol=1e-12)
    assert_allclose(ToolDeflection(LENGTH_M, LOAD_N).shifts(chain, Postures(hanging)), 0.0, atol=1e-12)


def test_a_tool_of_no_known_weight_does_not_bend(six_joints):
    assert not ToolDeflection(LENGTH_M, 0.0).shifts(six_joints.chain(), Postures(np.ones((2, 6)))).any()


def test_the_published_tool_sinks_an_eighth_of_a_millimetre(six_joints):
    level = Postures(np.zeros((1, 6)))  # stretched out: the flange's z is level
    welding_torch = ToolDeflection(0.4103, 1.535 * 9.80665)
    sunk = 0.00036 * welding_torch.shifts(six_joints.chain(), level)[0, :, 0]
    assert sunk[2] == pytest.approx(-0.125, abs=0.002)
    assert_allclose(sunk[:2], 0.0, atol=1e-12)
