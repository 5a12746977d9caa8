"""The points of a KRL program, changed so that the identified robot goes where the nominal one would go."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from cellctl.compensation.paths import SINGULAR, joints_for, least_singular
from cellctl.formats import ModelFile
from cellctl.formats.table_making import valid_region
from cellctl.kinematics import Floats, abc_from_rotation, inverse, inverse_pose, pose, pose_from_xyz_abc
from cellctl.kinematics.controller_readings import status_of, turn_of
from cellctl.krl import CARTESIAN, Span
from cellctl.krl.writing import number_text
from cellctl.operations.program_goals import Goal, Key, ProgramGoals, ProgramRobots
from cellctl.operations.program_motions import Part, Program, Written


@final
@dataclass(frozen=True, slots=True)
class Unchanged:
    """What stays as it was, and why. line: of the program or (part `dat`) of its data list."""

    part: Part
    line: int
    name: str
    reason: str

    @property
    def words(self) -> str:
        """The point and the reason."""
        named = self.name and not self.reason.startswith(self.name)
        return f"{self.name}: {self.reason}" if named else self.reason


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

    written: Written
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
    changed: dict[Key, Changed]
    left: tuple[Unchanged, ...]

    def file(self, left: Unchanged) -> str:
        """The name of the file with the place `left`."""
        return self.program.parts[left.part].name

    def values(self, part: Part) -> dict[Span, str]:
        """The new texts by their place in a file: for `KrlFile.replaced`."""
        return {
            each.written.point.numbers[label].span: text
            for (where, _), each in self.changed.items()
            if where == part
            for label, text in each.numbers.items()
        }


def compensate_program(
    program: Program, robots: ProgramRobots, *, method: str = "pseudo-target", limit_deg: float = 2.0
) -> CompensatedProgram:
    """Compensate the points of `program` for the robot of a model.

    limit_deg: largest correction of a joint. A point stays, with its reason, wherever anything about it is not certain.
    """
    goals = ProgramGoals(program, robots)
    compensated = _compensated(robots.model, list(_flat(goals)), method)
    changed = dict[Key, Changed]()
    for key, parts in compensated.items():
        made = _changed(robots.model, goals, parts, limit_deg)
        if isinstance(made, str):
            goals.left[key] = made
        else:
            changed[key] = made
    return CompensatedProgram(program, goals, changed, tuple(_unchanged(program, goals)))


def _flat(goals: ProgramGoals) -> Iterable[Goal]:
    return (goal for each in goals.goals.values() for goal in each)


def _compensated(model: ModelFile, goals: Sequence[Goal], method: str) -> dict[Key, list[Compensation | str]]:
    """Each goal compensated, all of one tool at once; the reason where the method does not reach it."""
    found = dict[Key, list[Compensation | str]]()
    by_robots = dict[bytes, list[Goal]]()
    for goal in goals:
        by_robots.setdefault(goal.robots.nominal.tool.tobytes(), []).append(goal)
        found[goal.written.key] = []
    for alike in by_robots.values():
        robots, wanted = alike[0].robots, np.stack([goal.pose for goal in alike])
        q = np.stack([goal.q for goal in alike])
        joints = joints_for(robots.nominal, robots.identified, wanted, q, method=method)
        sent = robots.nominal.forward(joints.compensated_q)
        before = np.linalg.norm(robots.identified.tcp(q) - wanted[:, :3, 3], axis=1)
        inside = model.inside(model.robot.joint_map().readings(q))
        for row, goal in enumerate(alike):
            made = Compensation(goal, joints.compensated_q[row], sent[row], float(before[row]), bool(inside[row]))
            found[goal.written.key].append(joints.reasons[row] or made)
    return found


def _changed(
    model: ModelFile, goals: ProgramGoals, parts: Sequence[Compensation | str], limit_deg: float
) -> Changed | str:
    """The changed point, or why it stays."""
    found = list[Compensation]()
    for part in parts:
        if isinstance(part, str):
            return part
        if (reason := _refusal(model, part, limit_deg)) is not None:
            return reason
        found.append(part)
    written, joints = found[0].goal.written, model.robot.joint_map()
    numbers = dict[str, str]()
    for part in found:
        numbers |= _numbers(model, part)
    last = found[-1]
    corrections = [np.abs(joints.readings(part.q) - joints.readings(part.goal.q)).max() for part in found]
    turn = _turn(model, last) if "T" in written.point.values and "A" in numbers else None
    if turn:
        numbers["T"] = str(turn[1])
    return Changed(
        written=written,
        lines=tuple(move.line for move in goals.uses[written.key]),
        numbers={label: text for label, text in numbers.items() if label in written.point.numbers},
        parts=tuple(found),
        correction_mm=float(np.linalg.norm(found[0].sent[:3, 3] - found[0].goal.pose[:3, 3])),
        correction_deg=float(max(corrections)),
        before_mm=found[0].before_mm,
        after_mm=_after(model, found[0], numbers),
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
        return "the correction would change the status S"
    return None


def _outside(readings: Floats, low: Floats, high: Floats) -> str | None:
    for axis, (value, least, most) in enumerate(zip(readings, low, high, strict=True), 1):
        if not least <= value <= most:
            return f"A{axis} {value:.3f}° is not within {least:g}…{most:g}°"
    return None


def _numbers(model: ModelFile, part: Compensation) -> dict[str, str]:
    """The components that a goal gives, as text."""
    if part.goal.base is None:
        values = dict(zip(part.goal.gives, model.robot.joint_map().readings(part.q), strict=True))
    else:
        seen = inverse_pose(part.goal.base) @ part.sent
        old = part.goal.written.point.values
        angles = _nearest_abc(abc_from_rotation(seen[:3, :3]), np.array([old[label] for label in "ABC"]))
        values = dict(zip(CARTESIAN, [*seen[:3, 3], *angles], strict=True))
    return {label: number_text(values[label]) for label in part.goal.gives}


def _nearest_abc(angles: Floats, old: Floats) -> Floats:
    """The same orientation by the angles A, B, C (3,), deg, nearest to `old`, each within ±180°."""
    ways = np.stack([angles, angles * [1, -1, 1] + 180.0])
    ways = (ways + 180.0) % 360.0 - 180.0
    away = np.abs((ways - old + 180.0) % 360.0 - 180.0).sum(axis=1)
    return np.asarray(ways[np.argmin(away)])


def _turn(model: ModelFile, part: Compensation) -> tuple[int, int] | None:
    """T before and after, where a joint's sign changes; other bits stay as they are written."""
    joints = model.robot.joint_map()
    flipped = int(turn_of(joints.readings(part.goal.q)) ^ turn_of(joints.readings(part.q)))
    old = int(part.goal.written.point.values["T"])
    return (old, old ^ flipped) if flipped else None


def _after(model: ModelFile, part: Compensation, numbers: dict[str, str]) -> float:
    """Predicted distance, mm, of the tool from the goal with the numbers as they are written."""
    values = part.goal.written.point.values | {label: float(text) for label, text in numbers.items()}
    if part.goal.base is None:
        q = model.robot.joint_map().model([values[label] for label in part.goal.gives])
    else:
        turned = part.sent if part.goal.gives == CARTESIAN[:3] else part.goal.base @ _pose(values)
        sent = pose(turned[:3, :3], (part.goal.base @ _pose(values))[:3, 3])
        q = inverse(part.goal.robots.nominal, sent, part.q).q
    return float(np.linalg.norm(part.goal.robots.identified.tcp(q) - part.goal.pose[:3, 3]))


def _pose(values: dict[str, float]) -> Floats:
    return pose_from_xyz_abc([values[label] for label in "XYZ"], [values[label] for label in "ABC"])


def _unchanged(program: Program, goals: ProgramGoals) -> Iterable[Unchanged]:
    """Lines that are not understood, motions without a point of these files, and points that stay."""
    for unknown in program.src.unknown:
        yield Unchanged("src", unknown.line, "", f"not understood: {unknown.reason}")
    for unknown in program.dat.unknown if program.dat else ():
        yield Unchanged("dat", unknown.line, "", f"not understood: {unknown.reason}")
    for move in program.moves:
        if move.fault:
            yield Unchanged("src", move.line, move.statement.kind, move.fault)
    for key, reason in goals.left.items():
        written = next(each for move in goals.uses[key] for each in move.uses if each.key == key)
        yield Unchanged(written.part, written.point.line, written.name, reason)
