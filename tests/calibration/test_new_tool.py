"""Ten touches of one sphere with a new tool, on a robot that an older model knows; the robot is kept."""

from dataclasses import replace

import numpy as np
import pytest

from cellctl.calibration import identify

SPHERE = [[1150.0, 0.0, 400.0]]
SHIFT = np.array([6.0, -4.0, 9.0])


@pytest.fixture(scope="module")
def older(draw, touch_task):
    """A robot and what sixty touches say of it."""
    touches = draw(3, 60)
    return touches.robot, identify(touch_task(touches)).identified


@pytest.fixture(scope="module")
def found(older, draw, touch_task):
    """Ten touches with the new tool, with the tool alone free; and the robot with that tool."""
    robot, before = older
    retooled = replace(robot, tool=robot.tool + SHIFT)
    touches = draw(4, 10, spheres=SPHERE, robot=retooled)
    count = before.unknowns.robot
    task = replace(
        touch_task(touches, deflection=True),
        model=before.state.model,
        prior=before.covariance[:count, :count],
        groups=frozenset({"tool"}),
    )
    return retooled, touches, identify(task).identified


def test_nothing_but_tool_and_centres_has_moved(older, found):
    before, after = older[1].state.model, found[2].state.model
    moved = {name for name, a, b in zip(before.names, before.deviations, after.deviations, strict=True) if a != b}
    assert moved == {"tool_x", "tool_y", "tool_z"}


def test_the_new_tool_comes_out_within_its_own_uncertainty(older, found):
    before, after = older[1].state.model, found[2].state.model
    shift = after.chain.tool_now[:3, 3] - before.chain.tool_now[:3, 3]
    names = [after.names.index(f"tool_{axis}") for axis in "xyz"]
    sigma = np.sqrt(np.diag(found[2].covariance)[names])
    turned = before.chain.tool_now[:3, :3]
    assert np.linalg.norm(shift - SHIFT) < 4.0 * np.linalg.norm(sigma)
    assert np.linalg.norm(sigma) < 1.0  # touches never saw the older one's flange any better
    assert np.allclose(turned, after.chain.tool_now[:3, :3])


def test_further_touches_with_it_land_on_the_spheres(found, draw, kr5):
    robot, touches, after = found
    further = draw(5, 40, spheres=SPHERE, robot=robot)
    further_at = further.centres[further.sphere]
    ours = after.state.points[further.sphere] - touches.centres[further.sphere]
    tips = after.state.model.tcp(kr5.joint_map().model(further.readings)) - ours
    distance = np.linalg.norm(tips - further_at, axis=1)
    assert np.sqrt(np.mean((distance - 31.3) ** 2)) < 0.15
