"""Where the tool shall be at each point of a program, and in which posture: goals for nominal and identified robot.

Both are in the robot's base frame (ROBROOT), where a program's poses are: the identified base is put on it, so that no
instrument's frame is left. The tool of a point is the controller's data for it. The identified robot carries the tool
that the model identified, if the program's tool data are the model's; with `arm_only` it carries the program's.

All poses are in the robot's base frame (ROBROOT), mm.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import final

import numpy as np

from cellctl.calibration import RobotModel
from cellctl.compensation.paths import Arc, Line, Segment, posture_at
from cellctl.compensation.postures import stated_posture
from cellctl.formats import ModelFile
from cellctl.formats.table_making import valid_region
from cellctl.kinematics import Floats, JointMap, SerialChain, inverse, pose_from_xyz_abc, rotation_vector
from cellctl.kinematics.controller_readings import status_of
from cellctl.operations.programs._language import Frame, Gives, Move, Numbers, Program, ProgramPoint

SAME_TOOL_MM, SAME_TOOL_DEG = 0.01, 0.01
"""Largest difference of two statements of one tool: files round."""

IDENTIFIED_TOOL_MM, IDENTIFIED_TOOL_DEG = 10.0, 3.0
"""A fit's tool that is further from the robot file's is another thing: a reflector, for instance."""


@final
@dataclass(frozen=True, eq=False)
class Robots:
    """nominal: as its controller has it, with the tool data of the point. identified: with the tool that it carries."""

    nominal: SerialChain
    identified: RobotModel


@final
@dataclass(frozen=True, eq=False)
class ProgramRobots:
    """The robots of a model by the tool of a point."""

    model: ModelFile
    arm_only: bool = False
    _known: dict[Frame, Robots | str] = field(default_factory=dict, init=False, repr=False)

    @property
    def tool_shift_mm(self) -> float:
        """Distance of the identified tool from the robot file's, in the flange frame."""
        return _apart(self.model.robot_model().chain.tool_now, self.model.robot.chain().tool)[0]

    def of(self, tool: Frame) -> Robots | str:
        """The robots for points with `tool`, or why its points cannot be compensated; made once for each tool."""
        if tool not in self._known:
            self._known[tool] = self._made(tool)
        return self._known[tool]

    def _made(self, tool: Frame) -> Robots | str:
        assert tool.numbers is not None
        taught, robot = _pose_of_numbers(tool.numbers), self.model.robot.chain().with_base(np.eye(4))
        found = self.model.robot_model()
        if self.arm_only:
            return Robots(robot.with_tool(taught), found.on(np.eye(4), taught))
        reason = _other_tool(tool, taught, robot.tool, found.chain.tool_now)
        identified = replace(found, chain=found.chain.with_base(np.eye(4)))
        return reason or Robots(robot.with_tool(taught), identified)


def _other_tool(tool: Frame, taught: Floats, in_file: Floats, identified: Floats) -> str:
    away, turned = _apart(taught, in_file)
    if away > SAME_TOOL_MM or turned > SAME_TOOL_DEG:
        what = f"wrong tool: {tool.name} is {away:.2f} mm and {turned:.2f}° from the tool of the model's robot file"
        return f"{what}; the tool was changed after the model, or is another one (--arm-only corrects the arm alone)"
    away, turned = _apart(identified, in_file)
    if away > IDENTIFIED_TOOL_MM or turned > IDENTIFIED_TOOL_DEG:
        what = f"wrong tool: the model was identified with a tool {away:.0f} mm and {turned:.0f}° from {tool.name}"
        return f"{what}, perhaps a reflector (--arm-only corrects the arm alone)"
    return ""


def _apart(one: Floats, other: Floats) -> tuple[float, float]:
    """Distance, mm, and angle, deg, of two poses."""
    turn = rotation_vector(one[:3, :3] @ other[:3, :3].T)
    return float(np.linalg.norm(one[:3, 3] - other[:3, 3])), float(np.rad2deg(np.linalg.norm(turn)))


def _pose_of_numbers(numbers: Numbers) -> Floats:
    return pose_from_xyz_abc(numbers[:3], numbers[3:])


_SAME_POSTURE = np.deg2rad(3.0)
_STATUS_BITS = 7


@final
@dataclass(frozen=True, eq=False)
class Goal:
    """pose (4, 4): where the tool shall be. q (n,): model angles, rad, of the nominal robot there. gives: what of the
    point is written from it. base: of the point; None where its numbers are joint readings.
    """

    point: ProgramPoint
    robots: Robots
    pose: Floats
    q: Floats
    gives: Gives
    base: Floats | None


@final
@dataclass(frozen=True, eq=False)
class Arrival:
    """The end of a motion: pose (4, 4) of the tool, and model angles (n,), rad, of the nominal robot."""

    pose: Floats
    q: Floats


@final
class ProgramGoals:
    """Goes through a program once. goals: by point. left: reason by point that stays. segments: the wanted way of each
    LIN and CIRC, by the index of the motion. arrivals: of the motions, where they are
    certain. robots: those of the model.
    """

    def __init__(self, program: Program, robots: ProgramRobots) -> None:
        self._program, self.robots = program, robots
        self.model = robots.model
        self.goals: dict[Hashable, list[Goal]] = defaultdict(list)
        self.left: dict[Hashable, str] = {}
        self.segments: dict[int, Segment] = {}
        self.arrivals: dict[int, Arrival] = {}
        region = valid_region(self.model)
        self._near = (np.array(region.min) + np.array(region.max)) / 2.0
        self._refuse_contradictions()
        for number, move in enumerate(program.moves):
            self._take(number, move)
        for key in self.left:
            self.goals.pop(key, None)

    @cached_property
    def uses(self) -> dict[Hashable, list[Move]]:
        """The motions of each point."""
        found: dict[Hashable, list[Move]] = defaultdict(list)
        for move in self._program.moves:
            for point in move.uses:
                found[point.key].append(move)
        return found

    @cached_property
    def _targets(self) -> set[Hashable]:
        return {move.target.key for move in self._program.moves if move.target}

    def _refuse_contradictions(self) -> None:
        """Points that one change cannot suit in all their motions."""
        for key, moves in self.uses.items():
            for kind in ("tool", "base"):
                frames: set[Frame] = {move.tool if kind == "tool" else move.base for move in moves}
                if len({frame.numbers for frame in frames}) > 1:
                    names = ", ".join(sorted(frame.name for frame in frames))
                    self._leave(key, f"used with several {kind}s: {names}")
            if len({move.angle_deg for move in moves}) > 1:
                self._leave(key, "used with different circular angles")

    def _leave(self, key: Hashable, reason: str) -> None:
        self.left.setdefault(key, reason)

    def _take(self, number: int, move: Move) -> None:
        reason = self._reason(move)
        robots = reason or self.robots.of(move.tool)
        if isinstance(robots, str):
            for point in move.uses:
                self._leave(point.key, robots)
            return
        assert move.target is not None
        if move.target.readings is not None:
            self._take_joints(number, move, robots)
        else:
            self._take_position(number, move, robots)

    def _reason(self, move: Move) -> str:
        """Why the points of a motion cannot be understood; empty where they can."""
        if move.fault or move.target is None:
            return f"its motion in line {move.line} is not understood: {move.fault}"
        if move.tool.numbers is None:
            return move.tool.reason
        if all(point.readings is None for point in move.uses):
            return move.base.reason if move.base.numbers is None else self.no_positions
        if move.kind not in ("PTP", "LIN"):
            return f"{move.kind} to joint readings"
        missing = [f"A{axis}" for axis in range(len(move.target.readings or ()) + 1, self.model.robot.n + 1)]
        return f"{move.target.title} has no {', '.join(missing)}" if missing else ""

    @cached_property
    def no_positions(self) -> str:
        """Why positions cannot be compensated with this model; empty where they can."""
        if not self._program.own_calibration or self.model.robot.calibration is not None:
            return ""
        what = "the controller computes positions with its arm's calibration, which the model's nominal robot has not"
        return f"{what}: identify from it (docs/reference/importing.md)"

    def _take_joints(self, number: int, move: Move, robots: Robots) -> None:
        assert move.target is not None
        assert move.target.readings is not None
        q = self._joints.model(np.array(move.target.readings[: self.model.robot.n]))
        goal = Goal(move.target, robots, robots.nominal.forward(q), q, "joints", None)
        if (segment := self._segment(move, goal.pose, np.eye(4))) is not None:
            assert move.start is not None
            arrival = posture_at(robots.nominal, segment, self.arrivals[move.start].q, 1.0)
            if arrival is None or np.abs(arrival - q).max() > _SAME_POSTURE:
                self._leave(move.target.key, f"{move.kind} does not arrive with these joints in line {move.line}")
                return
            self.segments[number] = segment
        self._put(number, move.target, goal)

    def _take_position(self, number: int, move: Move, robots: Robots) -> None:
        assert move.target is not None
        assert move.base.numbers is not None
        base = _pose_of_numbers(move.base.numbers)
        pose = base @ _written_pose(move.target)
        try:
            segment = self._segment(move, pose, base)
        except ValueError as error:
            for point in move.uses:
                self._leave(point.key, f"{error}, in line {move.line}")
            return
        q = self._posture(move, pose if segment is None else segment.finish, segment, robots)
        if q is None:
            return
        if segment is not None:
            self.segments[number] = segment
        if move.auxiliary is not None:
            self._take_auxiliary(move, segment, robots, base, q)
        if move.angle_deg is not None and segment is None:
            self._leave(move.target.key, f"the start of the circle in line {move.line} is not certain")
        elif isinstance(segment, Arc) and segment.angle is not None:
            self._put_turned_on(number, move, segment, robots, base, q)
        else:
            self._put(number, move.target, Goal(move.target, robots, pose, q, "pose", base))

    def _segment(self, move: Move, pose: Floats, base: Floats) -> Segment | None:
        """The wanted way; None for PTP and splines, or where the start is not certain. Raises ValueError: no circle."""
        start = self.arrivals.get(move.start) if move.start is not None else None
        if move.kind == "LIN" and start:
            return Line(start.pose, pose)
        if move.kind != "CIRC" or move.auxiliary is None or not start:
            return None
        angle = None if move.angle_deg is None else float(np.deg2rad(move.angle_deg))
        return Arc.of(start.pose, (base @ _written_pose(move.auxiliary))[:3, 3], pose, angle)

    def _posture(self, move: Move, finish: Floats, segment: Segment | None, robots: Robots) -> Floats | None:
        """Model angles at the end of a motion; None, and the point stays, where there are none."""
        assert move.target is not None
        status, turn = move.target.status, move.target.turn
        start = self.arrivals.get(move.start) if move.start is not None else None
        q = posture_at(robots.nominal, segment, start.q, 1.0) if segment and start else None
        if q is not None and not self._agrees(q, status, robots):
            self._leave(
                move.target.key, f"S {status} is not the posture in which LIN or CIRC arrives in line {move.line}"
            )
            return None
        if q is None:
            near = self._near if move.near is None else np.array(move.near)
            found = self._stated(robots, finish, near, status, turn)
            if isinstance(found, str):
                self._leave(move.target.key, found)
                return None
            q = self._joints.model(found)
        return q

    def _stated(self, robots: Robots, pose: Floats, near: Floats, status: int | None, turn: int | None) -> Floats | str:
        """Readings (n,), deg, of the posture nearest to `near` that S and T choose, or why there is none."""
        limits = self.model.robot.limits()
        known = status if self.model.robot.n == 6 else None
        find = partial(stated_posture, robots.nominal, self._joints, limits, pose, near)
        if (found := find(status=known, turn=turn)) is not None:
            return found
        if find() is None:
            return "out of the robot's reach or of its joint limits"
        return f"S {status}, T {turn} are of no posture within the joint limits that reaches it"

    def _agrees(self, q: Floats, status: int | None, robots: Robots) -> bool:
        if status is None or self.model.robot.n != 6:
            return True
        return int(status_of(robots.nominal, self._joints, self._joints.readings(q))) == status & _STATUS_BITS

    def _take_auxiliary(self, move: Move, arc: Segment | None, robots: Robots, base: Floats, end: Floats) -> None:
        """The auxiliary point: its place, with the orientation that the way has there, as its own is not used. Where
        the start of the circle is not certain, its own.
        """
        assert move.auxiliary is not None
        if move.auxiliary.key in self._targets:
            return
        if isinstance(arc, Arc):
            pose, q = arc.poses(arc.shares[:1])[0], self._on_the_way(move, arc, robots, arc.shares[0])
        else:
            pose = base @ _written_pose(move.auxiliary)
            found = inverse(robots.nominal, pose, end)
            q = found.q if found.converged else None
        if q is None:
            self._leave(move.auxiliary.key, f"the circle in line {move.line} cannot be followed to it")
        else:
            self._add(move.auxiliary, Goal(move.auxiliary, robots, pose, q, "place", base))

    def _put_turned_on(self, number: int, move: Move, arc: Arc, robots: Robots, base: Floats, q: Floats) -> None:
        """The end point of a circle with a circular angle: its place gives X, Y, Z; the way's end gives A, B, C."""
        assert move.target is not None
        share = arc.shares[1]
        at_place = self._on_the_way(move, arc, robots, share)
        if at_place is None:
            self._leave(move.target.key, f"the circle in line {move.line} cannot be followed to it")
            return
        place = Goal(move.target, robots, arc.poses([share])[0], at_place, "place", base)
        self._add(move.target, place)
        self._put(number, move.target, Goal(move.target, robots, arc.finish, q, "orientation", base))

    def _on_the_way(self, move: Move, arc: Arc, robots: Robots, share: float) -> Floats | None:
        assert move.start is not None
        return posture_at(robots.nominal, arc, self.arrivals[move.start].q, share)

    def _put(self, number: int, point: ProgramPoint, goal: Goal) -> None:
        """The goal at the end of a motion."""
        self.arrivals[number] = Arrival(goal.pose, goal.q)
        self._near = self._joints.readings(goal.q)
        self._add(point, goal)

    def _add(self, point: ProgramPoint, goal: Goal) -> None:
        """One goal for each set of components; a point that is reached in two postures stays."""
        known = [each for each in self.goals[point.key] if each.gives == goal.gives]
        if not known:
            self.goals[point.key].append(goal)
        elif np.abs((known[0].q - goal.q + np.pi) % (2.0 * np.pi) - np.pi).max() > _SAME_POSTURE:
            self._leave(point.key, "its motions reach it in different postures")

    @cached_property
    def _joints(self) -> JointMap:
        return self.model.robot.joint_map()


def _written_pose(point: ProgramPoint) -> Floats:
    assert point.position is not None
    return _pose_of_numbers(point.position)
