"""The cell's time: wall time on a real cell, simulated time on a simulated one; injected, never imported."""

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
