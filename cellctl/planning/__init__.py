"""Which poses to measure next, and the way there."""

from cellctl.planning._sample_finder import TargetOptions
from cellctl.planning._target_sets import METHODS, Method, TargetSet, plan_targets
from cellctl.planning._workspaces import JointRanges, TaskWorkspace
from cellctl.planning.measuring_poses import Counts, MeasuringPoses, PoseOptions, Sight, plan_measuring_poses
from cellctl.planning.touches import (
    BestTouches,
    OutOfReach,
    PlannedTouch,
    RobotPostures,
    SphereTarget,
    TouchOptions,
    plan_touches,
)
from cellctl.planning.ways import Plate, Reach

__all__ = [
    "METHODS",
    "BestTouches",
    "Counts",
    "JointRanges",
    "MeasuringPoses",
    "Method",
    "OutOfReach",
    "PlannedTouch",
    "Plate",
    "PoseOptions",
    "Reach",
    "RobotPostures",
    "Sight",
    "SphereTarget",
    "TargetOptions",
    "TargetSet",
    "TaskWorkspace",
    "TouchOptions",
    "plan_measuring_poses",
    "plan_targets",
    "plan_touches",
]
