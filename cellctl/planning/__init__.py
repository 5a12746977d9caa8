"""Which poses to measure next, and the way there."""

from cellctl.planning.measuring_poses import Counts, MeasuringPoses, PoseOptions, Sight, plan_measuring_poses
from cellctl.planning.obstacles import Plate
from cellctl.planning.touches import OutOfReach, RobotPostures, SphereTarget, TouchOptions, plan_touches
from cellctl.planning.tours import PlannedTouch

__all__ = [
    "Counts",
    "MeasuringPoses",
    "OutOfReach",
    "PlannedTouch",
    "Plate",
    "PoseOptions",
    "RobotPostures",
    "Sight",
    "SphereTarget",
    "TouchOptions",
    "plan_measuring_poses",
    "plan_touches",
]
