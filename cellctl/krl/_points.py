"""Points and other structures that a file gives as numbers: positions, joints, frames, data of motions."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias, final

from cellctl.files.spans import Span
from cellctl.krl._expressions import Aggregate, Expression, Number, Reference
from cellctl.krl._expressions import Literal as Constant
from cellctl.krl.statements import Assignment, Begin, Declaration, End, Motion, Statement

PointType: TypeAlias = Literal["FRAME", "POS", "E6POS", "AXIS", "E6AXIS"]

CARTESIAN = ("X", "Y", "Z", "A", "B", "C")
JOINTS = ("A1", "A2", "A3", "A4", "A5", "A6")
_CARTESIAN_TYPES = ("FRAME", "POS", "E6POS", "E3POS")
_JOINT_TYPES = ("AXIS", "E6AXIS", "E3AXIS")
_JOINT = re.compile(r"A[1-9]")
_EXTERNAL = re.compile(r"E[1-6]")
_ALLOWED = {"FRAME": r"[XYZABC]", "POS": r"[XYZABCST]", "AXIS": r"A[1-9]"}


@final
@dataclass(frozen=True, slots=True)
class Point:
    """A point written out in a file.

    name: as written, with its index; empty for one in a motion statement. type: as declared, else by its components.
    numbers: components in the file's order, upper case: X, Y, Z mm; A, B, C, A1…A9 and rotating E1…E6 deg; S, T.
    declared: in a data list or a declaration; else assigned by the program, or written in a motion. fault: why its
    values are not certain, empty where they are.
    """

    line: int
    span: Span
    name: str
    type: str
    numbers: Mapping[str, Number]
    declared: bool
    fault: str = ""

    @property
    def key(self) -> str:
        """The name in upper case."""
        return self.name.upper()

    @property
    def values(self) -> dict[str, float]:
        """Value of each component."""
        return {label: number.value for label, number in self.numbers.items()}

    @property
    def is_joints(self) -> bool:
        """Whether the point holds joint readings, not a position."""
        return self.type in _JOINT_TYPES

    @property
    def missing(self) -> tuple[str, ...]:
        """Components X…C, or A1…A6, that it does not give; the controller takes them from the point before."""
        return tuple(label for label in (JOINTS if self.is_joints else CARTESIAN) if label not in self.numbers)

    def spans(self) -> dict[str, Span]:
        """Place of each number in the file, with its sign."""
        return {label: number.span for label, number in self.numbers.items()}


def points_of(statements: tuple[Statement, ...]) -> Iterator[Point]:
    """All points of a file: declared, assigned, or written in a motion."""
    types: dict[str, str] = {}
    for statement, in_data in with_data(statements):
        if isinstance(statement, Declaration):
            types |= {variable.target.name.upper(): statement.type for variable in statement.variables}
        declared = in_data or isinstance(statement, Declaration)
        for name, value in _values(statement):
            point = point_of(value, statement.line, name, types.get(variable_of(name), ""), declared)
            if point is not None:
                yield point


def with_data(statements: tuple[Statement, ...]) -> Iterator[tuple[Statement, bool]]:
    """Each statement, and whether it is in a data list (DEFDAT … ENDDAT)."""
    in_data = False
    for statement in statements:
        if isinstance(statement, Begin | End):
            in_data = isinstance(statement, Begin) and statement.keyword == "DEFDAT"
        yield statement, in_data


def variable_of(name: str) -> str:
    """The variable of `P[3]` or `FP1.TOOL_NO`, upper case."""
    return name.upper().split("[")[0].split(".")[0]


def _values(statement: Statement) -> Iterator[tuple[str, Aggregate]]:
    """Name and aggregate of each point that a statement may hold; the distance of a relative motion is none."""
    pairs: list[tuple[str, Expression | None]] = []
    match statement:
        case Declaration():
            pairs = [(variable.target.written, variable.value) for variable in statement.variables]
        case Assignment():
            pairs = [(statement.target.written, statement.value)]
        case Motion() if not statement.kind.endswith("_REL"):
            pairs = [("", statement.auxiliary), ("", statement.target)]
        case _:
            pass
    yield from ((name, value) for name, value in pairs if isinstance(value, Aggregate))


def point_of(value: Aggregate, line: int, name: str = "", type_: str = "", declared: bool = False) -> Point | None:
    """The point that an aggregate is; None where it is another structure. type_: of its variable, if declared."""
    labels = {field.label for field in value.fields}
    kind = value.type or type_
    if kind not in (*_CARTESIAN_TYPES, *_JOINT_TYPES):
        kind = _type_by(labels) if not (value.type or type_) else ""
    if not kind:
        return None
    numbers: dict[str, Number] = {}
    faults = ["the index is not a number"] if "?" in name else []
    for field in value.fields:
        if not isinstance(field.value, Number):
            faults.append(f"{field.label} {_shown(field.value)}")
        elif not math.isfinite(field.value.value):
            faults.append(f"{field.label} is too large")
        elif field.label in numbers:
            faults.append(f"{field.label} is given twice")
        elif not _belongs(field.label, kind):
            faults.append(f"{kind} has no component {field.label}")
        else:
            numbers[field.label] = field.value
    return Point(line, value.span, name, kind, numbers, declared, "; ".join(faults))


def _shown(value: Expression) -> str:
    match value:
        case Reference():
            return f"'{value.written}' is not a number"
        case Constant():
            return f"'{value.text}' is not a number"
        case _:
            return "is computed"


def _type_by(labels: set[str]) -> str:
    external = any(_EXTERNAL.fullmatch(label) for label in labels)
    if labels & {"X", "Y", "Z"}:
        return "E6POS" if external else "POS" if labels & {"S", "T"} else "FRAME"
    if any(_JOINT.fullmatch(label) for label in labels):
        return "E6AXIS" if external else "AXIS"
    return "FRAME" if labels and labels <= set("ABC") else ""


def _belongs(label: str, kind: str) -> bool:
    external = kind.startswith(("E6", "E3"))
    plain = kind.removeprefix("E6").removeprefix("E3")
    return re.fullmatch(_ALLOWED[plain], label) is not None or (external and _EXTERNAL.fullmatch(label) is not None)


@final
@dataclass(frozen=True, slots=True)
class FrameData:
    """An FDAT: the tool and base of a taught point. ipo_frame: `#BASE` (tool on the robot) or `#TCP` (fixed tool).

    point2: the second name of the inline form, `" "` where there is none. None: not given.
    """

    tool_no: int | None
    base_no: int | None
    ipo_frame: str
    point2: str

    @classmethod
    def of(cls, value: Expression | None) -> FrameData | None:
        """The FDAT that an aggregate is; None where it is none."""
        if not isinstance(value, Aggregate):
            return None
        if value.field("TOOL_NO") is None and value.field("BASE_NO") is None:
            return None
        return cls(
            whole(value.field("TOOL_NO")),
            whole(value.field("BASE_NO")),
            _constant(value.field("IPO_FRAME")).upper().replace(" ", ""),
            _constant(value.field("POINT2[]")).strip('"'),
        )


def whole(value: Expression | None) -> int | None:
    """A whole number; None for anything else."""
    return int(value.value) if isinstance(value, Number) and value.value.is_integer() else None


def _constant(value: Expression | None) -> str:
    return value.text if isinstance(value, Constant) else ""
