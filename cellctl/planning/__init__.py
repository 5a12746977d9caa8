"""Which poses to measure next, and the way there."""

from cellctl.planning.touches import PlannedTouch, SphereTarget, TouchOptions, plan_touches

__all__ = ["PlannedTouch", "SphereTarget", "TouchOptions", "plan_touches"]
