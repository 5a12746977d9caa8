"""The points of a program, changed so that the identified robot goes where the nominal one would go."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from cellctl.compensation.paths import SINGULAR, joints_for, least_singular
from cellctl.formats import ModelFile
from cellctl.formats.table_making import valid_region
from cellctl.kinematics import Floats, inverse, inverse_pose, pose, pose_from_xyz_abc
from cellctl.kinematics.controller_readings import status_of, turn_of
from cellctl.operations.programs._goals import Goal, ProgramGoals, ProgramRobots
from cellctl.operations.programs._language import Program, ProgramPoint, Unchanged


@final
@dataclass(frozen=True, eq=False)
class Compensation:
    """One goal compensated. q (n,): compensated model angles, rad. sent (4, 4): pose to which the controller is sent,
    robot's base frame, mm. before_mm: distance of the identified robot's tool from the goal with the joints of the
    original point. inside: these joints lie in the model's measured region.
    """

    goal: Goal
    q: Floats
    sent: Floats
    before_mm: float
    inside: bool


@final
@dataclass(frozen=True, eq=False)
class Changed:
    """A compensated point. lines: of its motions. numbers: new text of each component. parts: its goals. correction_mm:
    shift of the point. correction_deg: largest correction of a joint. before_mm, after_mm: predicted distance of the
    tool from its wanted place, with the original numbers, and with the new ones as they are rounded. turn: T before and
    after, where it changes.
    """

    point: ProgramPoint
    lines: tuple[int, ...]
    numbers: dict[str, str]
    parts: tuple[Compensation, ...]
    correction_mm: float
    correction_deg: float
    before_mm: float
    after_mm: float
    turn: tuple[int, int] | None


@final
@dataclass(frozen=True, eq=False)
class CompensatedProgram:
    """The points that change, and what stays, in the order of the program. goals: what was wanted."""

    program: Program
    goals: ProgramGoals
    changed: dict[Hashable, Changed]
    left: tuple[Unchanged, ...]

    def file(self, left: Unchanged) -> str:
        """The name of the file with the place `left`."""
        return self.program.names[left.part]


def compensate_program(
    program: Program, robots: ProgramRobots, *, method: str = "pseudo-target", limit_deg: float = 2.0
) -> CompensatedProgram:
    """Compensate the points of `program` for the robot of a model.

    limit_deg: largest correction of a joint. A point stays, with its reason, wherever anything about it is not certain.
    """
    goals = ProgramGoals(program, robots)
    compensated = _compensated(robots.model, list(_flat(goals)), method)
    changed = dict[Hashable, Changed]()
    for key, parts in compensated.items():
        made = _changed(program, goals, parts, limit_deg)
        if isinstance(made, str):
            goals.left[key] = made
        else:
            changed[key] = made
    return CompensatedProgram(program, goals, changed, tuple(_unchanged(program, goals)))


def _flat(goals: ProgramGoals) -> Iterable[Goal]:
    return (goal for each in goals.goals.values() for goal in each)


def _compensated(model: ModelFile, goals: Sequence[Goal], method: str) -> dict[Hashable, list[Compensation | str]]:
    """Each goal compensated, all of one tool at once; the reason where the method does not reach it."""
    found = dict[Hashable, list[Compensation | str]]()
    by_robots = dict[bytes, list[Goal]]()
    for goal in goals:
        by_robots.setdefault(goal.robots.nominal.tool.tobytes(), []).append(goal)
        found[goal.point.key] = []
    for alike in by_robots.values():
        robots, wanted = alike[0].robots, np.stack([goal.pose for goal in alike])
        q = np.stack([goal.q for goal in alike])
        joints = joints_for(robots.nominal, robots.identified, wanted, q, method=method)
        sent = robots.nominal.forward(joints.compensated_q)
        before = np.linalg.norm(robots.identified.tcp(q) - wanted[:, :3, 3], axis=1)
        inside = model.inside(model.robot.joint_map().readings(q))
        for row, goal in enumerate(alike):
            made = Compensation(goal, joints.compensated_q[row], sent[row], float(before[row]), bool(inside[row]))
            found[goal.point.key].append(joints.reasons[row] or made)
    return found


def _changed(
    program: Program, goals: ProgramGoals, parts: Sequence[Compensation | str], limit_deg: float
) -> Changed | str:
    """The changed point, or why it stays."""
    found, model = list[Compensation](), goals.model
    for part in parts:
        if isinstance(part, str):
            return part
        if (reason := _refusal(model, part, limit_deg)) is not None:
            return reason
        found.append(part)
    point, joints = found[0].goal.point, model.robot.joint_map()
    values = {part.goal.gives: _value(model, part) for part in found}
    corrections = [np.abs(joints.readings(part.q) - joints.readings(part.goal.q)).max() for part in found]
    turn = _turn(model, found[-1]) if {"pose", "orientation"} & set(values) else None
    numbers, rewritten = program.rewritten(point, values, turn[1] if turn else None)
    return Changed(
        point=point,
        lines=tuple(move.line for move in goals.uses[point.key]),
        numbers=numbers,
        parts=tuple(found),
        correction_mm=float(np.linalg.norm(found[0].sent[:3, 3] - found[0].goal.pose[:3, 3])),
        correction_deg=float(max(corrections)),
        before_mm=found[0].before_mm,
        after_mm=_after(model, found[0], rewritten),
        turn=turn,
    )


def _refusal(model: ModelFile, part: Compensation, limit_deg: float) -> str | None:
    """Why the joints of a point must not be used; None where they may."""
    nominal = part.goal.robots.nominal
    before, after = (model.robot.joint_map().readings(q) for q in (part.goal.q, part.q))
    limits, region = model.robot.limits(), valid_region(model)
    for readings in (before, after):
        if (what := _outside(readings, limits[:, 0], limits[:, 1])) is not None:
            return f"{what}: the joint's limits"
    for readings in (before, after):
        if (what := _outside(readings, np.array(region.min), np.array(region.max))) is not None:
            return f"{what}: outside the measured region of the model"
    if not part.inside:
        return "outside the measured region of the model's residual field"
    if least_singular(nominal, part.goal.q) < SINGULAR:
        return "at a singularity: a small correction of the tool would be a large one of the joints"
    if (axis := int(np.argmax(np.abs(after - before)))) >= 0 and abs(after[axis] - before[axis]) > limit_deg:
        return f"A{axis + 1} would be corrected by {after[axis] - before[axis]:+.3f}°, more than {limit_deg:g}°"
    if model.robot.n == 6 and len(set(status_of(nominal, model.robot.joint_map(), [before, after]).tolist())) > 1:
        return "the correction would put shoulder, elbow or wrist on its other side (a KUKA's status S)"
    return None


def _outside(readings: Floats, low: Floats, high: Floats) -> str | None:
    for axis, (value, least, most) in enumerate(zip(readings, low, high, strict=True), 1):
        if not least <= value <= most:
            return f"A{axis} {value:.3f}° is not within {least:g}…{most:g}°"
    return None


def _value(model: ModelFile, part: Compensation) -> Floats:
    """What is written: joint readings, or the pose in the point's base."""
    if part.goal.base is None:
        return model.robot.joint_map().readings(part.q)
    return inverse_pose(part.goal.base) @ part.sent


def _turn(model: ModelFile, part: Compensation) -> tuple[int, int] | None:
    """T before and after, where a joint's sign changes; other bits stay as they are written."""
    if (old := part.goal.point.turn) is None:
        return None
    joints = model.robot.joint_map()
    flipped = int(turn_of(joints.readings(part.goal.q)) ^ turn_of(joints.readings(part.q)))
    return (old, old ^ flipped) if flipped else None


def _after(model: ModelFile, part: Compensation, rewritten: ProgramPoint) -> float:
    """Predicted distance, mm, of the tool from the goal with the numbers as they are written."""
    goal = part.goal
    if goal.base is None:
        assert rewritten.readings is not None
        q = model.robot.joint_map().model(rewritten.readings[: model.robot.n])
    else:
        assert rewritten.position is not None
        written = goal.base @ pose_from_xyz_abc(rewritten.position[:3], rewritten.position[3:])
        turned = part.sent if goal.gives == "place" else written
        q = inverse(goal.robots.nominal, pose(turned[:3, :3], written[:3, 3]), part.q).q
    return float(np.linalg.norm(goal.robots.identified.tcp(q) - goal.pose[:3, 3]))


def _unchanged(program: Program, goals: ProgramGoals) -> Iterable[Unchanged]:
    """Lines that are not understood, motions without a point of these files, and points that stay."""
    yield from program.not_understood
    main = next(iter(program.names))
    for move in program.moves:
        if move.fault:
            yield Unchanged(main, move.line, move.written_kind, move.fault)
    for key, reason in goals.left.items():
        point = next(each for move in goals.uses[key] for each in move.uses if each.key == key)
        yield Unchanged(point.part, point.line, point.title, reason)
