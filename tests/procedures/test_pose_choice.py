"""The poses of a tracker campaign, chosen by the error that they leave: seen by the instrument, judged by others."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from cellctl.files import load_yaml
from cellctl.formats import RobotFile, postures_of
from cellctl.planning.measuring_poses import MeasuringArm, unmeasurable
from procedures.steps.tracker.plan_inputs import PlanInputs
from procedures.steps.tracker.pose_choice import best_postures
from procedures.steps.tracker.pose_planning import planned_rounds, pose_limits
from procedures.steps.tracker.pose_plans import PosePlan
from tests.helpers.steps import CELL, ROBOT, Context


def context() -> Context:
    found = Context(robot_file=ROBOT, cell=load_yaml(CELL))
    found.seed = 3  # type: ignore[attr-defined]
    return found


def planned(choice: str) -> list[PosePlan]:
    inputs = PlanInputs(fit=24, held_out=10, from_both=0.0, choice=choice)  # type: ignore[arg-type]
    return [pose for each in planned_rounds(context(), inputs, None) for pose in each.poses]


@pytest.mark.long
def test_the_best_poses_can_be_measured_and_the_held_out_ones_are_within_their_joints() -> None:
    poses = planned("optimal")
    assert Counter(pose.kind for pose in poses) == {"fit": 24, "test": 10}
    robot = RobotFile.load(ROBOT)
    reach, sight, options = pose_limits(context(), 1)  # type: ignore[arg-type]
    home = np.array(postures_of(context().cell, robot, "turn").home)
    arm = MeasuringArm(robot.chain().with_base(np.eye(4)), robot.joint_map(), sight, home, options)
    readings = np.array([pose.joints for pose in poses])
    assert not unmeasurable(arm, reach, readings)
    fit = readings[[pose.kind == "fit" for pose in poses]]
    test = readings[[pose.kind == "test" for pose in poses]]
    assert ((test >= fit.min(axis=0)) & (test <= fit.max(axis=0))).all()
    assert [pose.joints for pose in planned("optimal")] == readings.tolist(), "the same seed, the same poses"
    kinds = [pose.kind for pose in poses]
    assert "test" in kinds[:17], "held-out poses are among the others, too"


def test_few_of_many_candidates_are_those_that_show_the_robot() -> None:
    """Of a hundred postures a tenth of a degree apart and twelve elsewhere, nearly all twelve are taken."""
    robot, rng = RobotFile.load(ROBOT), np.random.default_rng(1)
    low, high = np.array([-40, -110, 50, -70, 20, -90.0]), np.array([40, -50, 110, 70, 85, 90.0])
    near = (low + high) / 2.0 + rng.uniform(-0.05, 0.05, (100, 6))
    spread = rng.uniform(low, high, (12, 6))
    chosen = best_postures(robot, np.concatenate([near, spread]), 14, np.array([[120.0, 0.0, 80.0]]))
    assert len(set(chosen)) == 14
    assert len(set(chosen) & set(range(100, 112))) >= 10, "as many at random would be 2"
