"""Weight: which way it pulls, in the robot's own base frame."""

from __future__ import annotations

from typing import TypeAlias

STANDARD_GRAVITY = 9.80665
"""N/kg."""

Direction: TypeAlias = tuple[float, float, float]
"""A unit vector."""

DOWN: Direction = (0.0, 0.0, -1.0)
"""ĝ in the base frame of a robot on the floor; it differs on a wall, a ceiling or a slope."""
