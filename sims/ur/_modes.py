"""The controller's modes, by their numbers on the wire."""

from __future__ import annotations

from enum import IntEnum
from typing import final


@final
class RobotMode(IntEnum):
    """Of the arm's power and brakes."""

    POWER_OFF = 3
    BOOTING = 2
    IDLE = 5
    RUNNING = 7


@final
class SafetyMode(IntEnum):
    """Of the safety system: what holds the arm."""

    NORMAL = 1
    PROTECTIVE_STOP = 3
    SAFEGUARD_STOP = 5
    ROBOT_EMERGENCY_STOP = 7


@final
class RuntimeState(IntEnum):
    """Of the program."""

    STOPPED = 1
    PLAYING = 2
    PAUSING = 3
    PAUSED = 4


@final
class JointMode(IntEnum):
    """Of each joint."""

    POWER_OFF = 239
    IDLE = 255
    RUNNING = 253


EMERGENCY_STOPS = (SafetyMode.ROBOT_EMERGENCY_STOP,)


def safety_status_bits(mode: SafetyMode) -> int:
    """The bits of RTDE's `safety_status_bits`."""
    emergency = mode in EMERGENCY_STOPS
    held = mode is not SafetyMode.NORMAL
    bits = {
        0: mode is SafetyMode.NORMAL,
        2: mode is SafetyMode.PROTECTIVE_STOP,
        4: mode is SafetyMode.SAFEGUARD_STOP,
        6: mode is SafetyMode.ROBOT_EMERGENCY_STOP,
        7: emergency,
        10: held,
    }
    return sum(1 << bit for bit, on in bits.items() if on)
