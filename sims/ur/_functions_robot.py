"""Functions of URScript that move the arm, or tell where it is. Named and called as in the script manual."""

from __future__ import annotations

from typing import final

from sims.ur._board import Payload
from sims.ur._controller import Controller
from sims.ur._functions_data import pose
from sims.ur._kinematics import ORIENTATION_RAD, POSITION_M, Joints
from sims.ur._motion import six
from sims.ur._poses import matrix_of, pose_of
from sims.ur._script_expressions import PoseValue, Running, ScriptError, Value

NO_SOLUTION = "get_inverse_kin: unable to find an inverse kinematics solution"
FORCE_DAMPING, FORCE_GAIN = (0.0, 1.0), (0.0, 2.0)
"""What force mode's damping and gain may be. There is no force mode here: they are kept, without effect."""
LOOKAHEAD_S, GAIN = (0.03, 0.2), (100.0, 2000.0)
"""What those of `servoj` may be."""


@final
class RobotFunctions:
    """Each public method is a function of URScript."""

    def __init__(self, controller: Controller) -> None:
        self._controller, self._motion = controller, controller.motion

    # motions

    def movej(self, q: Value, a: float = 1.4, v: float = 1.05, t: float = 0.0, r: float = 0.0) -> Running:
        """To joints, or to a pose. Its blend radius has no effect: it stops there."""
        yield from self._motion.move_joints(self._motion.joints_of(q), a, v, t)

    def movel(self, pose: Value, a: float = 1.2, v: float = 0.25, t: float = 0.0, r: float = 0.0) -> Running:
        """To a pose, or to that of joints. Its blend radius has no effect: it stops there."""
        yield from self._motion.move_line(self._pose_of(pose), a, v, t)

    def movep(self, pose: Value, a: float = 1.2, v: float = 0.25, r: float = 0.0) -> Running:
        """As movel."""
        yield from self._motion.move_line(self._pose_of(pose), a, v, 0.0)

    def servoj(
        self,
        q: Value,
        a: float = 0.0,
        v: float = 0.0,
        t: float = 0.002,
        lookahead_time: float = 0.1,
        gain: float = 300.0,
    ) -> Running:
        """For the time t towards q; a and v have no effect, as on the controller."""
        lookahead_s = _within(lookahead_time, LOOKAHEAD_S, "lookahead_time")
        yield from self._motion.servo(six(q), t, lookahead_s, _within(gain, GAIN, "gain"))

    def speedj(self, qd: Value, a: float, t: float = 0.0) -> Running:
        yield from self._motion.speed_joints(six(qd), a, t)

    def speedl(self, xd: Value, a: float, t: float = 0.0, aRot: Value = "a") -> Running:
        yield from self._motion.speed_line(six(xd), a, t, a if isinstance(aRot, str) else float(aRot))

    def stopj(self, a: float = 2.0) -> Running:
        yield from self._motion.stop_joints(a)

    def stopl(self, a: float = 10.0, aRot: Value = "a") -> Running:
        yield from self._motion.stop_line(a)

    def sync(self) -> Running:
        """Use up this cycle."""
        yield

    def sleep(self, t: float) -> Running:
        until = self._controller.kernel.now + round(t * 1e9)
        while self._controller.kernel.now < until:
            yield

    def protective_stop(self) -> Running:
        self._controller.protective_stop(0, 0, "Protective Stop: by the program")
        yield

    # where it is

    def get_steptime(self) -> float:
        return self._controller.cycle_ns * 1e-9

    def is_steady(self) -> bool:
        return self._motion.steady()

    def get_actual_joint_positions(self) -> list[Value]:
        return list(self._motion.actual())

    def get_actual_joint_positions_history(self, steps: int = 0) -> list[Value]:
        """So many cycles ago; the oldest that is known where that is longer."""
        history = self._controller.history
        return list(history[max(0, len(history) - 1 - steps)])

    def get_actual_joint_speeds(self) -> list[Value]:
        return list(self._motion.actual_speed())

    def get_target_joint_positions(self) -> list[Value]:
        return list(self._motion.target)

    def get_target_joint_speeds(self) -> list[Value]:
        return list(self._motion.speed)

    def get_target_joint_accelerations(self) -> list[Value]:
        return list(self._motion.acceleration)

    def get_actual_tcp_pose(self) -> PoseValue:
        return PoseValue(self._motion.model.tcp(self._motion.actual(), self._motion.tool))

    def get_actual_tcp_speed(self) -> list[Value]:
        motion = self._motion
        return list(motion.model.velocity(motion.actual(), motion.tool, motion.actual_speed()))

    def get_target_tcp_pose(self) -> PoseValue:
        return PoseValue(self._motion.model.tcp(self._motion.target, self._motion.tool))

    def get_target_tcp_speed(self) -> list[Value]:
        motion = self._motion
        return list(motion.model.velocity(motion.target, motion.tool, motion.speed))

    def get_actual_tool_flange_pose(self) -> PoseValue:
        return PoseValue(pose_of(self._motion.model.flange(self._motion.actual())))

    def get_tcp_offset(self) -> PoseValue:
        return PoseValue(self._motion.tool_pose)

    def get_tcp_force(self) -> list[Value]:
        """Nothing pushes this arm."""
        return [0.0] * 6

    def force(self) -> float:
        return 0.0

    # kinematics

    def get_forward_kin(self, q: Value = None, tcp: Value = None) -> PoseValue:
        joints = self._motion.actual() if q is None else six(q)
        tool = self._motion.tool if tcp is None or isinstance(tcp, str) else matrix_of(pose(tcp))
        return PoseValue(self._motion.model.tcp(joints, tool))

    def get_inverse_kin(
        self,
        x: Value,
        qnear: Value = None,
        maxPositionError: float = POSITION_M,
        maxOrientationError: float = ORIENTATION_RAD,
        tcp: Value = None,
    ) -> list[Value]:
        found = self._solution(x, qnear, maxPositionError, maxOrientationError, tcp)
        if found is None:
            raise ScriptError(NO_SOLUTION)
        return list(found)

    def get_inverse_kin_has_solution(
        self,
        pose: Value,
        qnear: Value = None,
        maxPositionError: float = POSITION_M,
        maxOrientationError: float = ORIENTATION_RAD,
        tcp: Value = None,
    ) -> bool:
        return self._solution(pose, qnear, maxPositionError, maxOrientationError, tcp) is not None

    def is_within_safety_limits(self, pose: Value) -> bool:
        """Of a pose or joints: the joints' limits."""
        joints: Joints | None = self._solution(pose) if isinstance(pose, PoseValue) else six(pose)
        limits = self._motion.limits
        return joints is not None and all(
            low <= q <= high for q, low, high in zip(joints, limits.least, limits.most, strict=True)
        )

    # what it carries

    def set_tcp(self, pose: Value, tcp_name: str = "") -> None:
        if not isinstance(pose, PoseValue):
            raise ScriptError("Type error: set_tcp: a pose is expected")
        self._motion.set_tool(pose)

    def set_payload(self, m: float, cog: Value = None) -> None:
        """Without a centre of gravity it is at the TCP."""
        at = cog if cog is not None else list(self._motion.tool_pose[:3])
        self._controller.board.payload = Payload(float(m), _triple(at))

    def set_payload_mass(self, m: float) -> None:
        self._controller.board.payload.mass = float(m)

    def set_payload_cog(self, CoG: Value) -> None:
        self._controller.board.payload.cog = _triple(CoG)

    def set_target_payload(self, m: float, cog: Value, inertia: Value = None, transition_time: float = 0.0) -> None:
        self._controller.board.payload = Payload(float(m), _triple(cog), six(inertia) if inertia else (0.0,) * 6)

    def get_target_payload(self) -> float:
        return self._controller.board.payload.mass

    def get_target_payload_cog(self) -> list[Value]:
        return list(self._controller.board.payload.cog)

    def get_target_payload_inertia(self) -> list[Value]:
        return list(self._controller.board.payload.inertia)

    def force_mode_set_damping(self, damping: float) -> None:
        _within(damping, FORCE_DAMPING, "damping")

    def force_mode_set_gain_scaling(self, scaling: float) -> None:
        _within(scaling, FORCE_GAIN, "scaling")

    def _pose_of(self, value: Value) -> list[float]:
        if isinstance(value, PoseValue):
            return value
        return list(self._motion.model.tcp(six(value), self._motion.tool))

    def _solution(
        self,
        x: Value,
        near: Value = None,
        position_m: float = POSITION_M,
        orientation_rad: float = ORIENTATION_RAD,
        tcp: Value = None,
    ) -> Joints | None:
        tool = self._motion.tool if tcp is None or isinstance(tcp, str) else matrix_of(pose(tcp))
        start = self._motion.target if near is None else six(near)
        return self._motion.model.joints_at(pose(x), start, tool, position_m, orientation_rad)


def _within(value: float, limits: tuple[float, float], name: str) -> float:
    low, high = limits
    if not low <= value <= high:
        raise ScriptError(f"{name} is from {low:g} to {high:g}, not {value:g}")
    return float(value)


def _triple(value: Value) -> tuple[float, ...]:
    if not isinstance(value, list) or len(value) != 3:
        raise ScriptError("Type error: a list of three numbers is expected")
    return tuple(float(part) for part in value)
