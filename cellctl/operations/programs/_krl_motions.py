"""KRL motions: from where to which point, with which tool, base and orientation. No mathematics."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import takewhile
from typing import Literal, TypeAlias, final

from cellctl.krl import (
    CARTESIAN,
    Aggregate,
    Assignment,
    Begin,
    Call,
    Control,
    Declaration,
    Expression,
    FrameChoice,
    Invocation,
    KrlFile,
    Motion,
    MotionFrames,
    Number,
    Point,
    Reference,
    Spline,
    Statement,
    Unknown,
    frame_values,
    motion_frames,
    point_of,
    references,
)
from cellctl.krl import Literal as Constant
from cellctl.operations.programs._language import Frame, FrameKind, Move, Numbers, ProgramPoint

_COMPONENTS = {"$ORI_TYPE": "ORI_TYP", "$CIRC_TYPE": "CIRC_TYP"}
_DEFAULTS = {"$ORI_TYPE": "#VAR", "$CIRC_TYPE": "#BASE"}
UNKNOWN = "not certain"


@final
class Modes:
    """`$ORI_TYPE` and `$CIRC_TYPE` in force, from assignments and from the LDAT of the inline forms.

    data: files with the LDAT. Without any of these both are as after BAS(#INITMOV,0).
    """

    def __init__(self, data: Sequence[KrlFile]) -> None:
        self._data = data
        self._now = dict(_DEFAULTS)
        self._ldat: Expression | None = None
        self._block: tuple[Assignment, ...] = ()

    def assign(self, statement: Assignment) -> None:
        """An assignment of the program."""
        name = statement.target.written.upper()
        if name == "LDAT_ACT":
            self._ldat = statement.value
        elif name in self._now:
            self._now[name] = self._mode(statement.value, name)

    def call(self, call: Call) -> None:
        """A call of BAS."""
        command = call.arguments[0] if call.arguments else None
        name = command.text.upper() if isinstance(command, Constant) else ""
        if name == "#INITMOV":
            self._now = dict(_DEFAULTS)
        elif name == "#CP_PARAMS" and self._ldat is not None:
            self._now = {name: self._mode(self._ldat, name) for name in self._now}

    def spline(self, statement: Spline) -> None:
        """The begin or end of a spline block."""
        self._block = statement.settings

    def of(self, motion: Motion) -> tuple[str, str]:
        """`$ORI_TYPE` and `$CIRC_TYPE` of a motion."""
        here = dict(self._now)
        for setting in (*self._block, *motion.settings) if motion.spline else motion.settings:
            name = setting.target.written.upper()
            if name in here:
                here[name] = self._mode(setting.value, name)
        return here["$ORI_TYPE"], here["$CIRC_TYPE"]

    def _mode(self, value: Expression | None, name: str) -> str:
        """`#VAR` of a constant, of an LDAT, or of `SORI_TYP(LCPDAT1)`."""
        if isinstance(value, Call):
            return self._mode(value.arguments[0] if value.arguments else None, name)
        if isinstance(value, Reference):
            declared = (file.declared.get(value.name.upper()) for file in self._data)
            value = next((found for found in declared if found is not None), None)
        if isinstance(value, Aggregate):
            value = value.field(_COMPONENTS[name]) or Constant(value.span, _DEFAULTS[name])
        return value.text.upper().replace(" ", "") if isinstance(value, Constant) else UNKNOWN


Part: TypeAlias = Literal["src", "dat"]


@final
class ProgramPoints:
    """Finds points. parts: the program, and its data list if there is one."""

    def __init__(self, parts: Mapping[Part, KrlFile]) -> None:
        self._parts, self._src = parts, parts["src"]

    def of(self, expression: Expression | None) -> ProgramPoint | str:
        """The point of a motion, or why it is not one that can be changed."""
        if isinstance(expression, Reference):
            return self._named(expression)
        if not isinstance(expression, Aggregate):
            return "the point is computed"
        point = point_of(expression, self._src.text.count("\n", 0, expression.span.start) + 1)
        return _usable("src", point) if point else "not a point"

    def _named(self, reference: Reference) -> ProgramPoint | str:
        key, name = reference.key, reference.name.upper()
        if key is None:
            return f"the index of {reference.written} is computed"
        found = [(part, each) for part, file in self._parts.items() for each in file.points if each.key == key]
        if not found:
            return f"{reference.name} is not in these files"
        if len(found) > 1:
            return f"{reference.name} is given {len(found)} times"
        if not found[0][1].declared:
            return f"{reference.name} is assigned in the program"
        if name in self._shared:
            return f"{reference.name} is GLOBAL: other programs may use it"
        if name in self._mentions:
            lines = ", ".join(str(line) for line in self._mentions[name])
            return f"{reference.name} is also used in line {lines}, not as the point of a motion"
        return _usable(*found[0])

    @cached_property
    def _mentions(self) -> dict[str, list[int]]:
        """Lines of the program in which a name occurs, other than as the point of a motion."""
        found = defaultdict[str, list[int]](list)
        for statement in self._src.statements:
            for name in set(_mentioned(statement)):
                found[name].append(statement.line)
        return found

    @cached_property
    def _shared(self) -> frozenset[str]:
        """Points that are declared GLOBAL."""
        declared = [one for file in self._parts.values() for one in file.of(Declaration) if one.is_global]
        return frozenset(variable.target.name.upper() for one in declared for variable in one.variables)


def _usable(part: Part, point: Point) -> ProgramPoint | str:
    read = point_read(part, point)
    if point.fault:
        return f"{read.title}: {point.fault}"
    if point.missing:
        return f"{read.title} has no {', '.join(point.missing)}"
    moved = [label for label, value in point.values.items() if label[0] == "E" and abs(value) > 1e-9]
    return f"{read.title} moves the external axis {', '.join(moved)}" if moved else read


def point_read(part: Part, point: Point, changed: Mapping[str, float] | None = None) -> ProgramPoint:
    """A point of a file; changed: components that replace its own."""
    values = point.values | dict(changed or {})
    status, turn = (int(values[name]) if name in values else None for name in "ST")
    position = readings = None
    if point.is_joints:
        axes = takewhile(values.__contains__, (f"A{axis}" for axis in range(1, 10)))
        readings = tuple(values[axis] for axis in axes)
    elif not point.missing:
        position = tuple(values[label] for label in CARTESIAN)
    return ProgramPoint((part, point.span), part, point.line, point.name, position, readings, status, turn)


def _mentioned(statement: Statement) -> Iterator[str]:
    match statement:
        case Assignment():
            yield statement.target.name.upper()
            yield from _names(statement.value)
        case Invocation():
            yield from _names(statement.call)
        case Control() | Unknown():
            yield from statement.names
        case Motion():
            for value in (statement.target, statement.auxiliary):
                if not isinstance(value, Reference) or value.key is None:
                    yield from _names(value)
            for setting in statement.settings:
                yield from _names(setting.value)
        case Declaration():
            for variable in statement.variables:
                yield from _names(variable.value)
        case _:
            pass


def _names(expression: Expression | None) -> Iterator[str]:
    return (reference.name.upper() for reference in references(expression))


_KINDS = {"SPTP": "PTP", "SLIN": "LIN", "SCIRC": "CIRC"}
_STAYS = frozenset(
    {"WAIT", "HALT", "CONTINUE", "TRIGGER", "SIGNAL", "INTERRUPT", "EXT", "EXTFCT", "IF", "SWITCH", "STRUC", "ENUM",
     "CONST_VEL", "TIME_BLOCK", "CONFIRM", "ANOUT", "ANIN", "IMPORT", "CHANNEL", "ON_ERROR_PROCEED"}
)  # fmt: skip
"""Control statements after which the robot is where the motion before left it."""

_MOVE_NOTHING = ("SET_CD_PARAMS", "PULSE")
"""Subprograms of the system in inline forms: collision detection, outputs."""


@final
@dataclass(frozen=True)
class KrlMotions:
    """Reads the motions of a program with its data list and the controller's `$config.dat`, None where there is none.

    tool, base: stated by a person, for all motions.
    """

    src: KrlFile
    dat: KrlFile | None
    config: KrlFile | None
    tool: Numbers | None = None
    base: Numbers | None = None

    @cached_property
    def parts(self) -> dict[Part, KrlFile]:
        """Program and data list, if there is one."""
        return {"src": self.src, "dat": self.dat} if self.dat else {"src": self.src}

    @cached_property
    def points(self) -> ProgramPoints:
        """The points that its motions name or write out."""
        return ProgramPoints(self.parts)

    @cached_property
    def data(self) -> tuple[KrlFile, ...]:
        """Files with values: data list, `$config.dat`."""
        return tuple(file for file in (self.dat, self.config) if file)

    @cached_property
    def frames(self) -> dict[int, MotionFrames]:
        """Tool and base of each motion, by its place in the program."""
        return {frames.motion.span.start: frames for frames in motion_frames(self.src, self.data)}

    @cached_property
    def moves(self) -> tuple[Move, ...]:
        """All motions of the robot, in the order of the file."""
        return tuple(_moves(self))

    def several(self, kind: FrameKind) -> list[str]:
        """The tools or bases of the program's motions, where there are several."""
        found = {_choice(frames, kind) for frames in self.frames.values()}
        names = {
            str(choice.number) if choice.frame is None else "a frame written out"
            for choice in found
            if not choice.reason
        }
        return sorted(names) if len(names) > 1 else []

    def frame(self, motion: Motion, kind: FrameKind) -> Frame:
        """The tool or base of a motion."""
        found = self.frames[motion.span.start]
        choice, array, stated = _choice(found, kind), f"{kind.upper()}_DATA", getattr(self, kind)
        name = f"{array}[{choice.number}]" if choice.number else f"{kind.upper()}_NO 0" if choice.number == 0 else kind
        if found.fixed_tool:
            return Frame(name, None, "its tool is fixed in the cell (#TCP)")
        if stated is not None:
            return Frame(f"--{kind}", stated)
        if choice.reason:
            return Frame(name, None, f"its {kind} is not certain: {choice.reason}")
        values = frame_values(choice, array, self.data)
        if values is None:
            if self.config:
                cure = f"define it there, give the $config.dat of this controller, or --{kind}"
                return Frame(name, None, f"{name} is not defined in {self.config.name}: {cure}")
            return Frame(name, None, f"{name} is not known: give --config '$config.dat', or --{kind}")
        return Frame(name, tuple(values[label] for label in CARTESIAN))


def _choice(frames: MotionFrames, kind: FrameKind) -> FrameChoice:
    return frames.tool if kind == "tool" else frames.base


def _moves(program: KrlMotions) -> Iterator[Move]:
    """The motions in order. After a label, a branch or the call of a subprogram the place before is not certain."""
    previous, count, modes = None, 0, Modes(program.data)
    for statement in program.src.statements:
        match statement:
            case Motion() if statement.kind != "ASYPTP":
                yield _move(program, statement, modes, previous)
                previous, count = count, count + 1
            case Assignment():
                modes.assign(statement)
            case Invocation() if statement.call.name.upper() == "BAS":
                modes.call(statement.call)
            case Spline():
                modes.spline(statement)
            case Invocation() if statement.call.name.upper() in _MOVE_NOTHING:
                pass
            case Invocation() | Unknown() | Begin():
                previous = None
            case Control() if statement.keyword not in _STAYS:
                previous = None
            case _:
                pass


def _move(program: KrlMotions, motion: Motion, modes: Modes, previous: int | None) -> Move:
    faults = ["the motion is relative"] if motion.kind.endswith("_REL") else []
    angle = motion.circular_angle
    if angle is not None and not isinstance(angle, Number):
        faults.append("its circular angle is computed")
    asked = (motion.target, motion.auxiliary) if not faults else ()
    points = [program.points.of(expression) if expression else None for expression in asked]
    faults += [point for point in points if isinstance(point, str)]
    target, auxiliary = [point if isinstance(point, ProgramPoint) else None for point in [*points, None, None][:2]]
    kind = _KINDS.get(motion.kind, motion.kind)
    if target is not None and target.readings is not None and kind != "PTP":
        faults.append(f"{kind} to joint readings")
    orientation, circle = modes.of(motion)
    evenly = orientation == "#VAR" and (kind != "CIRC" or circle == "#BASE")
    return Move(
        place=motion.span.start,
        line=motion.line,
        kind=kind,
        written_kind=motion.kind,
        target=target,
        auxiliary=auxiliary,
        angle_deg=angle.value if isinstance(angle, Number) else None,
        tool=program.frame(motion, "tool"),
        base=program.frame(motion, "base"),
        start=previous,
        fault="; ".join(dict.fromkeys(faults)),
        other_way="" if evenly else f"computed for orientation #VAR, #BASE only; here {orientation}, {circle}",
    )
