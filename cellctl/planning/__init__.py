"""Which poses to measure next, and the way there."""

from cellctl.planning.touches import OutOfReach, PlannedTouch, SphereTarget, TouchOptions, plan_touches

__all__ = ["OutOfReach", "PlannedTouch", "SphereTarget", "TouchOptions", "plan_touches"]
