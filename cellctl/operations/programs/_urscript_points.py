"""Points, features and tools of a URScript program, as far as they are constant.

Poses of a script are p[x, y, z, rx, ry, rz], m and a rotation vector in rad; joints are rad. Here they become mm and
degrees.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import final

import numpy as np
from scipy.spatial.transform import Rotation

from cellctl.files.spans import Span
from cellctl.kinematics import Floats, abc_from_rotation, inverse_pose, pose, pose_from_xyz_abc
from cellctl.operations.programs._language import Frame, Numbers, ProgramPoint
from cellctl.urscript import (
    Assignment,
    Branches,
    Call,
    Elements,
    Evaluation,
    Expression,
    Leaving,
    Loop,
    Name,
    Number,
    ScriptFile,
    Statement,
    calls,
    every,
    within,
)

PART = "script"
POSE = ("X", "Y", "Z", "RX", "RY", "RZ")
KINDS = {"movej": "PTP", "optimovej": "PTP", "movel": "LIN", "optimovel": "LIN", "movep": "LIN", "movec": "CIRC"}
_FIRST = {"movej": "q", "movec": "pose_via", "optimovej": "target", "optimovel": "target"}
"""Names of the first argument; of others it is `pose`."""
RADIUS = {"movej": 4, "movel": 4, "movep": 3, "movec": 4, "optimovej": 3, "optimovel": 3}
"""Place of the argument r: the blend radius."""
ROBOTS_BASE = Frame("the robot's base", (0.0,) * 6)


@final
@dataclass(frozen=True, slots=True)
class Component:
    """A number of a point: value = the number that stands at `span` times `factor`. m or rad."""

    span: Span
    value: float
    factor: float


def component(expression: Expression) -> Component | None:
    """A number, or `d2r(number)`; None for what is computed."""
    if isinstance(expression, Number):
        return Component(expression.span, expression.value, 1.0)
    if isinstance(expression, Call) and expression.name == "d2r" and len(expression.arguments) == 1:
        degrees = expression.arguments[0]
        if isinstance(degrees, Number):
            return Component(degrees.span, float(np.deg2rad(degrees.value)), float(np.deg2rad(1.0)))
    return None


@final
@dataclass(frozen=True, slots=True)
class ScriptPoint:
    """A list of joints, or a pose. components: by q1 … or X … RZ."""

    span: Span
    line: int
    name: str
    components: Mapping[str, Component]
    is_pose: bool

    def read(self, changed: Mapping[str, float] | None = None) -> ProgramPoint:
        """The point in mm and degrees; changed: components, m or rad, that replace its own."""
        values = {label: each.value for label, each in self.components.items()} | dict(changed or {})
        numbers = np.array(list(values.values()))
        if self.is_pose:
            return ProgramPoint(self.span, PART, self.line, self.name, numbers_of(pose_of(numbers)))
        return ProgramPoint(self.span, PART, self.line, self.name, None, tuple(np.rad2deg(numbers).tolist()))


def pose_of(numbers: Floats) -> Floats:
    """A pose (4, 4), mm, of x, y, z, rx, ry, rz, m and rad."""
    return pose(Rotation.from_rotvec(numbers[3:]).as_matrix(), 1000.0 * numbers[:3])


def numbers_of(matrix: Floats) -> Numbers:
    """X, Y, Z, A, B, C of a pose (4, 4)."""
    return (*matrix[:3, 3].tolist(), *abc_from_rotation(matrix[:3, :3]).tolist())


@final
@dataclass(frozen=True, slots=True)
class Target:
    """Where a motion goes: a point, or the reason why there is none that can be changed."""

    point: ScriptPoint | str
    base: Frame = ROBOTS_BASE
    near: Numbers | None = None


def uncertain_tool(reason: str) -> Frame:
    """A tool that is not known, and why."""
    return Frame("tool", None, f"its tool is not certain: {reason}")


@final
@dataclass(frozen=True)
class ScriptPoints:
    """Finds the points of motions, and constant poses."""

    file: ScriptFile

    def tool(self, call: Call, line: int) -> Frame:
        """The tool of a `set_tcp`."""
        expression = call.argument(0, "pose")
        numbers = self.constant_pose(expression) if expression is not None else None
        if numbers is None:
            return uncertain_tool(f"set_tcp in line {line} is computed")
        return Frame(f"the TCP of line {line}", numbers_of(numbers))

    def constant_pose(self, expression: Expression, depth: int = 0) -> Floats | None:
        """A constant pose (4, 4), mm: written out, a variable's only value, `pose_trans`, `pose_inv`; else None."""
        if isinstance(expression, Name):
            value = self.file.values.get(expression.text)
            return self.constant_pose(value, depth + 1) if value is not None and depth < 9 else None
        if isinstance(expression, Elements) and expression.is_pose:
            parts = [component(item) for item in expression.items]
            numbers = [part.value for part in parts if part is not None]
            return pose_of(np.array(numbers)) if len(numbers) == len(parts) == len(POSE) else None
        if isinstance(expression, Call) and expression.name in ("pose_trans", "pose_inv"):
            factors = [self.constant_pose(each, depth) for each in expression.arguments]
            known = [each for each in factors if each is not None]
            if len(known) == len(factors) == 2 and expression.name == "pose_trans":
                return known[0] @ known[1]
            if len(known) == len(factors) == 1 and expression.name == "pose_inv":
                return inverse_pose(known[0])
        return None

    def targets(self, call: Call) -> list[Target]:
        """The point of a motion; of a circle the point on the way and the end."""
        first = call.argument(0, _FIRST.get(call.name, "pose"))
        asked = [first, call.argument(1, "pose_to")] if call.name == "movec" else [first]
        return [self._target(each) if each is not None else Target("it has no point") for each in asked]

    def _target(self, expression: Expression, depth: int = 0) -> Target:
        if isinstance(expression, Call) and expression.name == "get_inverse_kin" and not depth:
            return self._by_inverse(expression)
        if isinstance(expression, Call) and expression.name == "pose_trans" and len(expression.arguments) == 2:
            given, inner_point = expression.arguments
            found, feature = self._target(inner_point, depth + 1), self.constant_pose(given)
            if isinstance(found.point, str):
                return found
            if not found.point.is_pose:
                return Target("pose_trans of joints")
            name = self.file.source(given.span)
            if feature is None or found.base.numbers is None:
                return replace(found, base=Frame(name, None, f"the feature {name} is computed, or changes"))
            inner = pose_from_xyz_abc(found.base.numbers[:3], found.base.numbers[3:])
            return replace(found, base=Frame(name, numbers_of(feature @ inner)))
        return Target(self._point(expression))

    def _by_inverse(self, call: Call) -> Target:
        """`get_inverse_kin(x, qnear)`: the pose x in the posture nearest to qnear, or to where the arm is."""
        x, near = call.argument(0, "x"), call.argument(1, "qnear")
        if x is None:
            return Target("it has no point")
        if call.argument(4, "tcp") is not None:
            return Target("get_inverse_kin with a TCP of its own")
        found = self._target(x, 1)
        if isinstance(found.point, ScriptPoint) and not found.point.is_pose:
            return Target("get_inverse_kin of joints")
        if near is None or (isinstance(near, Call) and near.name == "get_actual_joint_positions"):
            return found
        value = self.file.values.get(near.text) if isinstance(near, Name) else near
        joints = self._elements(value, "", near.span) if isinstance(value, Elements) else "computed"
        if isinstance(joints, str) or joints.is_pose:
            return Target("qnear of its get_inverse_kin is computed")
        return replace(found, near=joints.read().readings)

    def _point(self, expression: Expression) -> ScriptPoint | str:
        if isinstance(expression, Elements):
            return self._elements(expression, "", expression.span)
        if not isinstance(expression, Name):
            return "the point is computed"
        name = expression.text
        if name not in self.file.values:
            return f"{name} is not in this file"
        value = self.file.values[name]
        if value is None:
            return f"{name} is assigned more than once, is a parameter, or stands in a line that is not understood"
        if not isinstance(value, Elements):
            return f"{name} is computed"
        if name in self._mentions:
            lines = ", ".join(str(line) for line in self._mentions[name])
            return f"{name} is also used in line {lines}, not as the point of a motion"
        return self._elements(value, name, value.span)

    def _elements(self, elements: Elements, name: str, span: Span) -> ScriptPoint | str:
        labels = POSE if elements.is_pose else tuple(f"q{axis}" for axis in range(1, len(elements.items) + 1))
        kind, title = "a pose" if elements.is_pose else "a list of joints", name or "the point"
        parts = [component(item) for item in elements.items]
        if len(parts) != len(POSE):
            return f"{title} has {len(parts)} numbers, and {kind} has {len(POSE)}"
        known = [part for part in parts if part is not None]
        if len(known) < len(parts):
            return f"{title}: a number of it is computed"
        components = dict(zip(labels, known, strict=True))
        return ScriptPoint(span, self.file.line_of(elements.span), name, components, elements.is_pose)

    @cached_property
    def _mentions(self) -> dict[str, list[int]]:
        """Lines in which a variable occurs other than as the point of a motion, or as qnear."""
        found: dict[str, list[int]] = {}
        for each in every(self.file.statements):
            for name in dict.fromkeys(_mentioned(each)):
                found.setdefault(name, []).append(each.line)
        return found


def _expressions(statement: Statement) -> Iterator[Expression]:
    match statement:
        case Assignment() | Evaluation():
            yield statement.value
        case Leaving() if statement.value is not None:
            yield statement.value
        case Branches():
            yield from statement.conditions
        case Loop():
            yield statement.condition
        case _:
            pass


def calls_of(statement: Statement) -> Iterator[Call]:
    """The calls in a statement, without those of the blocks in it."""
    return (call for expression in _expressions(statement) for call in calls(expression))


def calls_within(statement: Statement) -> Iterator[Call]:
    """The calls in a statement and in the blocks in it."""
    return (call for each in every([statement]) for call in calls_of(each))


def _mentioned(statement: Statement) -> Iterator[str]:
    for expression in _expressions(statement):
        free = set[Span]()
        if isinstance(statement, Evaluation) and isinstance(expression, Call) and expression.name in KINDS:
            free = set(places_of_points(expression))
        yield from (each.text for each in within(expression) if isinstance(each, Name) and each.span not in free)


def places_of_points(motion: Call) -> Iterator[Span]:
    """Where a motion names its points, and qnear."""
    count = 2 if motion.name == "movec" else 1
    given = [*motion.arguments[:count], *(value for key, value in motion.named.items() if key not in "avtr")]
    for each in given:
        inner = each
        if isinstance(inner, Call) and inner.name == "get_inverse_kin":
            yield from (near.span for near in [inner.argument(1, "qnear")] if near is not None)
            inner = inner.argument(0, "x") or inner
        while isinstance(inner, Call) and inner.name == "pose_trans" and len(inner.arguments) == 2:
            inner = inner.arguments[1]
        yield inner.span
