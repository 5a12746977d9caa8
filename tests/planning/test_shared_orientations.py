"""Touches in groups of one tool orientation, on the shipped robot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cellctl.formats import RobotFile
from cellctl.planning import OutOfReach, SphereTarget
from cellctl.planning.shared_orientations import OrientedTouch, plan_oriented_touches
from cellctl.planning.ways import Reach
from tests.helpers.arms import KR5_POSTURES

ROBOT = RobotFile.load(Path(__file__).parents[2] / "procedures" / "robots" / "kr5_r1400.yaml")
SPHERES = [SphereTarget("S1", (950.0, -350.0, 250.0), 31.3), SphereTarget("P1", (850.0, 0.0, 550.0), 31.3)]
LIMITS = Reach(*(tuple(column) for column in ROBOT.limits().T.tolist()))


def planned(orientations: int, touches: int, spheres: list[SphereTarget] = SPHERES) -> list[OrientedTouch]:
    return plan_oriented_touches(
        ROBOT.chain(), ROBOT.joint_map(), LIMITS, KR5_POSTURES, spheres, 0, orientations, touches, seed=5
    )


def tools(touches: list[OrientedTouch]) -> Rotation:
    """The tool's orientation at each planned start."""
    readings = np.array([each.touch.start for each in touches])
    return Rotation.from_matrix(ROBOT.chain().forward(ROBOT.joint_map().model(readings))[:, :3, :3])


def test_touches_of_a_group_share_the_tool_orientation_and_groups_differ() -> None:
    touches = planned(5, 4)
    group, turned = np.array([each.orientation for each in touches]), tools(touches)
    assert np.bincount(group).tolist() == [4] * 5
    first = {number: turned[int(np.flatnonzero(group == number)[0])] for number in range(5)}
    for number, each in zip(group, turned, strict=True):
        assert np.degrees((each * first[number].inv()).magnitude()) < 0.01
    apart = [np.degrees((first[a] * first[b].inv()).magnitude()) for a in range(5) for b in range(a)]
    assert min(apart) > 15.0


def test_the_plan_begins_and_ends_at_home_and_is_the_same_each_time() -> None:
    touches = planned(4, 3)
    assert touches[0].touch.origin == pytest.approx(KR5_POSTURES.home)
    assert touches[-1].touch.retreat[-1] == pytest.approx(KR5_POSTURES.home)
    assert touches == planned(4, 3)


@pytest.mark.long
def test_a_sphere_out_of_reach_is_named() -> None:
    far = [SphereTarget("S1", (2950.0, 0.0, 250.0), 31.3)]
    with pytest.raises(OutOfReach, match="only 0 of 4 tool orientations reach 3 touches each on sphere S1"):
        planned(4, 3, far)
