"""The cell's time: wall time on a real cell, simulated time on a simulated one; injected, never imported."""

from cellctl.clock._minimum_delay import DelayFit, MinimumDelayFit
from cellctl.clock._wires import Wire
from cellctl.clock.clocks import Clock, LockstepClock, Timer, TimeReader, WallClock, calendar_time, reader_of

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
