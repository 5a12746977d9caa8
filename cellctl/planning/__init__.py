"""Which poses to measure next, and the way there."""

from cellctl.planning._sample_finder import TargetOptions
from cellctl.planning._target_sets import METHODS, Method, TargetSet, plan_targets
from cellctl.planning._workspaces import JointRanges, TaskWorkspace
from cellctl.planning.design import CHECKED_RISE, chosen_rows
from cellctl.planning.measuring_poses import (
    Counts,
    MeasuringArm,
    MeasuringPoses,
    PoseOptions,
    Sight,
    measuring_postures,
    plan_given_poses,
    plan_measuring_poses,
    unmeasurable,
)
from cellctl.planning.shared_orientations import plan_oriented_touches
from cellctl.planning.stopping import BatchProgress, PredictedError, StopLimits, ended_by, root_after
from cellctl.planning.touches import (
    BestTouches,
    OutOfReach,
    PlannedTouch,
    RobotPostures,
    SphereTarget,
    TouchOptions,
    moved_touch,
    plan_touches,
    spheres_of,
)
from cellctl.planning.ways import Obstacles, Plate, Reach

__all__ = [
    "CHECKED_RISE",
    "METHODS",
    "BatchProgress",
    "BestTouches",
    "Counts",
    "JointRanges",
    "MeasuringArm",
    "MeasuringPoses",
    "Method",
    "Obstacles",
    "OutOfReach",
    "PlannedTouch",
    "Plate",
    "PoseOptions",
    "PredictedError",
    "Reach",
    "RobotPostures",
    "Sight",
    "SphereTarget",
    "StopLimits",
    "TargetOptions",
    "TargetSet",
    "TaskWorkspace",
    "TouchOptions",
    "chosen_rows",
    "ended_by",
    "measuring_postures",
    "moved_touch",
    "plan_given_poses",
    "plan_measuring_poses",
    "plan_oriented_touches",
    "plan_targets",
    "plan_touches",
    "root_after",
    "spheres_of",
    "unmeasurable",
]
