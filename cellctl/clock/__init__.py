"""Time of the cell: wall time on a real cell, the simulated cell's own on a simulated one; injected, never imported."""

from cellctl.clock.calendar import calendar_time
from cellctl.clock.clocks import Clock, LockstepClock, Timer, WallClock
from cellctl.clock.minimum_delay import DelayFit, MinimumDelayFit
from cellctl.clock.reading import TimeReader, reader_of
from cellctl.clock.wires import Wire

__all__ = [
    "Clock",
    "DelayFit",
    "LockstepClock",
    "MinimumDelayFit",
    "TimeReader",
    "Timer",
    "WallClock",
    "Wire",
    "calendar_time",
    "reader_of",
]
