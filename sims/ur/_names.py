"""Events of this simulator, for the schedule of faults."""

from __future__ import annotations

PROGRAM = "ur.program"
SPEED = "ur.speed"
