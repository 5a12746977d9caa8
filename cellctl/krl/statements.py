"""Statements of a KRL file. Each has its line (from 1) and its place, without comment and white space around it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias, final

from cellctl.files.spans import Span
from cellctl.krl._expressions import Call, Expression, Reference

MotionKind: TypeAlias = Literal[
    "PTP", "LIN", "CIRC", "SPTP", "SLIN", "SCIRC", "SPL",
    "PTP_REL", "LIN_REL", "CIRC_REL", "SPTP_REL", "SLIN_REL", "SCIRC_REL", "SPL_REL", "ASYPTP",
]  # fmt: skip


@final
@dataclass(frozen=True, slots=True)
class Header:
    """`&ACCESS RVP`, `&REL 3`, `&PARAM …`. text: after the ampersand."""

    line: int
    span: Span
    text: str


@final
@dataclass(frozen=True, slots=True)
class Comment:
    """A comment, alone on its line or after a statement. text: after the semicolon."""

    line: int
    span: Span
    text: str


@final
@dataclass(frozen=True, slots=True)
class InlineForm:
    """A motion of the pendant's inline form, as its fold shows it: `PTP P1 CONT Vel=100 % PDAT1 Tool[1]:torch Base[2]`.

    What the robot does is in the statements of the fold, not here. points: as shown, of a circle auxiliary and end
    point. data: `PDAT1`, `CPDAT2`. tool, base: None where the form shows none.
    """

    kind: str
    points: tuple[str, ...]
    approximated: bool
    data: str
    tool: int | None
    tool_name: str
    base: int | None
    base_name: str


@final
@dataclass(frozen=True, slots=True)
class Fold:
    """`;FOLD title;%{PE}…`. title: up to the next semicolon. form: None where it is no inline form of a motion."""

    line: int
    span: Span
    title: str
    form: InlineForm | None


@final
@dataclass(frozen=True, slots=True)
class EndFold:
    """`;ENDFOLD`."""

    line: int
    span: Span


@final
@dataclass(frozen=True, slots=True)
class Begin:
    """`DEF`, `DEFFCT` or `DEFDAT` with the name of the program, function or data list.

    inputs: for each parameter whether it is `:IN`, which leaves the caller's variable unchanged.
    """

    line: int
    span: Span
    keyword: str
    name: str
    is_global: bool
    inputs: tuple[bool, ...] = ()


@final
@dataclass(frozen=True, slots=True)
class End:
    """`END`, `ENDFCT` or `ENDDAT`."""

    line: int
    span: Span
    keyword: str


@final
@dataclass(frozen=True, slots=True)
class Declared:
    """One variable of a declaration, with its value in a data list (None: no value)."""

    target: Reference
    value: Expression | None


@final
@dataclass(frozen=True, slots=True)
class Declaration:
    """`DECL [GLOBAL] [CONST] E6POS XP1={…}`, `INT I,J`. type: upper case."""

    line: int
    span: Span
    type: str
    variables: tuple[Declared, ...]
    is_global: bool


@final
@dataclass(frozen=True, slots=True)
class Assignment:
    """`$BASE=BASE_DATA[2]`, `XP1.Z=XP1.Z+10`; also each part of a `WITH`."""

    line: int
    span: Span
    target: Reference
    value: Expression


@final
@dataclass(frozen=True, slots=True)
class Motion:
    """A motion to `target`.

    auxiliary: point on the circle, CIRC and SCIRC only. circular_angle: of `CA`, deg; None: the circle ends in the
    target. approximation: `C_PTP`, `C_DIS`, … settings: of `WITH`. reference: `#BASE` or `#TOOL` of a relative motion,
    upper case. spline: in a spline block.
    """

    line: int
    span: Span
    kind: MotionKind
    target: Expression
    auxiliary: Expression | None = None
    circular_angle: Expression | None = None
    approximation: tuple[str, ...] = ()
    settings: tuple[Assignment, ...] = ()
    reference: str = ""
    spline: bool = False


@final
@dataclass(frozen=True, slots=True)
class Spline:
    """`SPLINE`, `PTP_SPLINE` with the settings of its `WITH`, or `ENDSPLINE`."""

    line: int
    span: Span
    keyword: str
    settings: tuple[Assignment, ...]


@final
@dataclass(frozen=True, slots=True)
class Invocation:
    """A subprogram called as a statement: `BAS(#PTP_PARAMS,100)`, `PICK( )`."""

    line: int
    span: Span
    call: Call


@final
@dataclass(frozen=True, slots=True)
class Control:
    """Control flow, interrupts, signals, types, labels: read without loss, not interpreted.

    keyword: `IF`, `WAIT`, `TRIGGER`, …; `:` for a label. names: all names in it, upper case.
    """

    line: int
    span: Span
    keyword: str
    names: frozenset[str]


@final
@dataclass(frozen=True, slots=True)
class Unknown:
    """A line that is not understood, with the reason. name: the variable that it declares or assigns, where seen.

    names: all names in it, upper case.
    """

    line: int
    span: Span
    reason: str
    name: str
    names: frozenset[str]


Statement: TypeAlias = (
    Header
    | Comment
    | Fold
    | EndFold
    | Begin
    | End
    | Declaration
    | Assignment
    | Motion
    | Spline
    | Invocation
    | Control
    | Unknown
)
