"""Events of this simulator, for the schedule of faults."""

from __future__ import annotations

PROGRAM = "ur.program"
SPEED = "ur.speed"
QUERY = ("contact_input", "contact_level")
"""Settings of an address that are the driver's alone."""
