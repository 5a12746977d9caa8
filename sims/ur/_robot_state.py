"""The robot state of the primary and secondary interface, ten times a second, and the package of the real-time one.

All numbers are big-endian; a package of the robot state: size (4), type, content. Layouts: the maker's client interface
documents, 5.9 (robot state), 3.15 and 5.10 (real-time).
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from typing import final

from sims.ur._controller import Controller
from sims.ur._modes import EMERGENCY_STOPS, RobotMode, RuntimeState, SafetyMode
from sims.ur._poses import NO_TOOL

ROBOT_STATE = 16
MODE_DATA, JOINT_DATA, TOOL_DATA, MASTERBOARD_DATA, CARTESIAN_INFO, KINEMATICS_INFO = 0, 1, 2, 3, 4, 5
"""Types of the packages."""
VOLTAGE = 48.0
TOOL_RUNNING = 253
CALIBRATED, UNCALIBRATED = 0, 1
"""Status in the kinematics package: a calibration is there, or the arm is nominal."""
REALTIME_SIZES = {"e": 1220, "cb3": 1108}
RESERVED_MODE, RESERVED_BOARD = {"e": 1, "cb3": 0}, {"e": 3, "cb3": 0}
"""Bytes at the end of the packages of mode and masterboard: three-position device, selector, and reserved ones."""
STATE_NS = 100_000_000
"""Ten robot states a second."""


@final
class RobotState:
    """Of one controller."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        rows = controller.model.rows
        known = controller.setup.settings["calibration_knows"]
        columns = [[getattr(row, name) for row in rows] for name in ("theta", "a", "d", "alpha")]
        packed = struct.pack(">24d", *(value for column in columns for value in column))
        sums = [zlib.crc32(struct.pack(">4d", row.theta, row.a, row.d, row.alpha)) for row in rows]
        status = CALIBRATED if known else UNCALIBRATED
        self._kinematics = _package(KINEMATICS_INFO, struct.pack(">6I", *sums) + packed + struct.pack(">I", status))

    def message(self) -> bytes:
        """All packages, now."""
        packages = (
            self._mode() + self._joints() + self._tool() + self._masterboard() + self._cartesian() + self._kinematics
        )
        return struct.pack(">iB", 5 + len(packages), ROBOT_STATE) + packages

    def realtime(self) -> bytes:
        """The package of the real-time interface, now."""
        values = realtime_values(self._controller)
        size = REALTIME_SIZES[self._controller.series]
        count = (size - 4) // 8
        return struct.pack(f">i{count}d", size, *values[:count])

    def _mode(self) -> bytes:
        controller = self._controller
        runtime = controller.runtime.state
        flags = (
            True,
            True,
            controller.powered,
            controller.safety in EMERGENCY_STOPS,
            controller.safety is SafetyMode.PROTECTIVE_STOP,
            runtime in (RuntimeState.PLAYING, RuntimeState.PAUSING),
            runtime is RuntimeState.PAUSED,
        )
        motion = controller.motion
        body = struct.pack(
            ">Q7?BBddd",
            controller.timestamp_us(),
            *flags,
            controller.mode,
            0,
            motion.slider,
            motion.scaling,
            1.0,
        )
        return _package(MODE_DATA, body + bytes(RESERVED_MODE[controller.series]))

    def _joints(self) -> bytes:
        controller = self._controller
        motion = controller.motion
        volts = VOLTAGE if controller.powered else 0.0
        warm = controller.scene.environment().arm_c
        rows = zip(motion.actual(), motion.target, motion.actual_speed(), controller.currents(), strict=True)
        mode = controller.joint_mode
        return _package(
            JOINT_DATA,
            b"".join(struct.pack(">dddffffB", q, t, v, a, volts, warm, warm, mode) for q, t, v, a in rows),
        )

    def _tool(self) -> bytes:
        warm = self._controller.scene.environment().arm_c
        volts = VOLTAGE if self._controller.powered else 0.0
        board = self._controller.board
        return _package(
            TOOL_DATA, struct.pack(">BBddfBffB", 0, 0, 0.0, 0.0, volts, board.tool_voltage, 0.0, warm, TOOL_RUNNING)
        )

    def _masterboard(self) -> bytes:
        controller = self._controller
        board, voltage = controller.board, controller.board.analog_out_voltage
        body = struct.pack(
            ">iiBBddbbddffffBBBI",
            controller.digital_in(),
            board.digital_out,
            0,
            0,
            0.0,
            0.0,
            voltage[0],
            voltage[1],
            board.analog_value(0),
            board.analog_value(1),
            controller.scene.environment().arm_c,
            VOLTAGE if controller.powered else 0.0,
            sum(map(abs, controller.currents(noise=False))),
            0.0,
            controller.safety,
            0,
            0,
            0,
        )
        return _package(MASTERBOARD_DATA, body + bytes(RESERVED_BOARD[controller.series]))

    def _cartesian(self) -> bytes:
        motion = self._controller.motion
        pose = motion.model.tcp(motion.actual(), motion.tool)
        return _package(CARTESIAN_INFO, struct.pack(">12d", *pose, *motion.tool_pose))


def _package(kind: int, content: bytes) -> bytes:
    return struct.pack(">iB", 5 + len(content), kind) + content


def realtime_values(controller: Controller) -> Sequence[float]:
    """The numbers of a real-time package of 5.10, after its size; earlier versions end before."""
    motion, board = controller.motion, controller.board
    actual, speed = motion.actual(), motion.actual_speed()
    model, tool = motion.model, motion.tool
    currents = controller.currents()
    volts = VOLTAGE if controller.powered else 0.0
    idle = 0.0 if controller.mode is RobotMode.RUNNING else 1.0
    elbow = model.frames(actual)[2][3]
    six = NO_TOOL
    return [
        controller.timestamp(),
        *motion.target,
        *motion.speed,
        *motion.acceleration,
        *controller.currents(noise=False),
        *controller.moments(),
        *actual,
        *speed,
        *currents,
        *currents,
        *model.tcp(actual, tool),
        *model.velocity(actual, tool, speed),
        *six,
        *model.tcp(motion.target, tool),
        *model.velocity(motion.target, tool, motion.speed),
        float(controller.digital_in()),
        *(controller.scene.environment().arm_c,) * 6,
        0.0,
        0.0,
        float(controller.mode),
        *(float(controller.joint_mode),) * 6,
        float(controller.safety),
        *six,
        0.0,
        0.0,
        9.82,
        *six,
        motion.scaling,
        0.0,
        0.0,
        0.0,
        volts,
        volts,
        sum(map(abs, currents)) * (1.0 - idle),
        *(volts,) * 6,
        float(board.digital_out),
        float(controller.runtime.state),
        *elbow,
        0.0,
        0.0,
        0.0,
        float(controller.safety),
        0.0,
        0.0,
        0.0,
        board.payload.mass,
        *board.payload.cog,
        *board.payload.inertia,
    ]
