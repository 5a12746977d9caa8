"""Which poses to measure next, and the way there."""

from cellctl.planning.obstacles import Plate
from cellctl.planning.touches import OutOfReach, RobotPostures, SphereTarget, TouchOptions, plan_touches
from cellctl.planning.tours import PlannedTouch

__all__ = ["OutOfReach", "PlannedTouch", "Plate", "RobotPostures", "SphereTarget", "TouchOptions", "plan_touches"]
