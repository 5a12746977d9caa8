"""One robot in three forms: the same tool at every joint angle, by forward kinematics written here."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellctl.kinematics import JointAxis, Link, SerialChain, pose_from_xyz_abc, to_craig, to_mdh, to_poe
from tests.helpers.arms import KR5_LINKS

UR10 = [
    Link(0, 127.3, 0, np.pi / 2),
    Link(0, 0, -612, 0, 0.0),
    Link(0, 0, -572.3, 0, 0.0),
    Link(0, 163.941, 0, np.pi / 2),
    Link(0, 115.7, 0, -np.pi / 2),
    Link(0, 92.2, 0, 0),
]
X, Y, Z = np.eye(3)
CONVERSIONS = {"poe": to_poe, "mdh-hayati": to_mdh, "dh-craig": to_craig}


def turn(axis, angle, point=(0.0, 0.0, 0.0)):
    """A turn about an axis through a point, after Rodrigues."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    result = np.eye(4)
    result[:3, :3] += np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)
    result[:3, 3] = point - result[:3, :3] @ point
    return result


def slide(axis, length):
    result = np.eye(4)
    result[:3, 3] = np.multiply(axis, length)
    return result


def own_forward(chain, q):
    """From the numbers of the chain's table alone (no deviations): base, links or twists, tool."""
    here = chain.base
    if chain.convention == "poe":
        for axis, angle in zip(chain.table.axes, q, strict=True):
            here = here @ turn(axis.direction, angle, axis.point)
        return here @ chain.table.home @ chain.tool
    for row, angle in zip(chain.table.links, q, strict=True):
        joint = turn(Z, angle + row.theta) @ slide(Z, row.d)
        link = turn(X, row.alpha) @ slide(X, row.a) @ turn(Y, row.beta or 0.0)
        here = here @ (joint @ link if chain.convention == "mdh-hayati" else link @ joint)
    return here @ chain.tool


def assert_same(converted, chain, rng):
    assert not converted.deviations.any()
    q = rng.uniform(-3, 3, (12, chain.n))
    for angles, wanted in zip(q, chain.forward(q), strict=True):
        found = own_forward(converted, angles)
        np.testing.assert_allclose(found[:3, 3], wanted[:3, 3], rtol=0, atol=1e-9)
        np.testing.assert_allclose(found[:3, :3], wanted[:3, :3], rtol=0, atol=1e-12)


def random_axes(rng, n):
    """Axes square to, crossing, parallel, near parallel, opposite to the one before; some through the same point."""
    direction, point, axes = np.array([0.0, 0.0, 1.0]), np.zeros(3), []
    for _ in range(n):
        axes.append(JointAxis.through(point, direction))
        lean = rng.choice([0.0, 1e-9, 1e-4, 0.01, 0.02, np.pi / 2, np.pi, np.pi - 1e-5, rng.uniform(0, np.pi)])
        about = np.cross(direction, rng.standard_normal(3))
        about /= np.linalg.norm(about)
        direction = direction * np.cos(lean) + np.cross(about, direction) * np.sin(lean)
        point = point + rng.choice([0.0, 1e-7, 1.0]) * rng.uniform(-600, 600, 3)
    return axes


@settings(max_examples=60)
@given(st.integers(0, 100_000), st.integers(1, 9), st.sampled_from(sorted(CONVERSIONS)))
def test_any_robot_of_revolute_joints_becomes_any_form(seed, n, to):
    rng = np.random.default_rng(seed)
    home, base, tool = (pose_from_xyz_abc(rng.uniform(-500, 500, 3), rng.uniform(-180, 180, 3)) for _ in range(3))
    chain = SerialChain.from_axes(random_axes(rng, n), home, base, tool)
    assert_same(CONVERSIONS[to](chain), chain, rng)


@pytest.mark.parametrize("to", sorted(CONVERSIONS))
@pytest.mark.parametrize("source", sorted(CONVERSIONS))
@pytest.mark.parametrize("links", [KR5_LINKS, UR10], ids=["KR5", "UR10"])
def test_an_identified_robot_keeps_its_identified_geometry(links, source, to):
    rng = np.random.default_rng(5)
    base, tool = pose_from_xyz_abc([1200, -300, 50], [130, 4, -7]), pose_from_xyz_abc([60, 50, 410], [38, 4, 0])
    chain = CONVERSIONS[source](SerialChain.from_links("mdh-hayati", links, base, tool))
    deviations = np.where(chain.parameter_turns, 2e-3, 0.8) * rng.standard_normal(len(chain.parameters))
    identified = chain.with_parameters(deviations)
    assert_same(CONVERSIONS[to](identified), identified, rng)


@pytest.mark.parametrize("between", [to_poe, to_craig])
@pytest.mark.parametrize("links", [KR5_LINKS, UR10], ids=["KR5", "UR10"])
def test_a_makers_table_comes_back_from_the_other_forms_as_it_was(links, between):
    chain = SerialChain.from_links("mdh-hayati", links, None, pose_from_xyz_abc([60, 50, 410], [38, 4, 0]))
    back = to_mdh(between(chain))
    for found, given_row in zip(back.table.links, links, strict=True):
        assert (found.beta is None) == (given_row.beta is None)
        values = [[row.theta, row.d, row.a, row.alpha, row.beta or 0.0] for row in (found, given_row)]
        np.testing.assert_allclose(*values, rtol=0, atol=1e-12)
    np.testing.assert_allclose(back.base, np.eye(4), atol=1e-12)
    np.testing.assert_allclose(back.tool, chain.tool, atol=1e-12)


def test_axes_a_hair_from_parallel_get_beta_and_no_far_away_common_perpendicular():
    leaning = JointAxis.through([600, 0, 0], [1e-5, 1e-5, 1.0])
    chain = SerialChain.from_axes([JointAxis.through([0, 0, 0], [0, 0, 1]), leaning], np.eye(4))
    first, last = to_mdh(chain).table.links
    assert first.beta == pytest.approx(1e-5, rel=1e-6)
    assert (first.d, first.a) == (0.0, pytest.approx(600))
    assert last.beta is None


def test_the_flange_of_a_craig_table_lies_on_the_last_axis_and_the_tool_takes_the_rest():
    crooked = [*KR5_LINKS[:5], Link(0.3, 80, 25, 0.4)]
    chain = SerialChain.from_links("mdh-hayati", crooked, None, pose_from_xyz_abc([0, 0, 100], [0, 0, 0]))
    craig = to_craig(chain)
    q = np.zeros(6)
    away = np.linalg.inv(craig.forward_flange(q)) @ chain.forward_flange(q)
    assert np.hypot(*away[:2, 3]) == pytest.approx(25)
    np.testing.assert_allclose(craig.tool, away @ chain.tool, atol=1e-9)
