"""A KRL file: its bytes, what is understood of them, and the same bytes with a few places changed."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import zip_longest
from typing import TypeAlias, TypeVar, final

from cellctl.files.spans import FileInPlace, Span
from cellctl.krl._expressions import Expression, calls, references
from cellctl.krl._grammar import statements
from cellctl.krl._points import FrameData, Point, points_of, variable_of, with_data
from cellctl.krl._tokens import lines
from cellctl.krl.statements import (
    Assignment,
    Begin,
    Control,
    Declaration,
    Invocation,
    Motion,
    Statement,
    Unknown,
)

Kind = TypeVar("Kind")

_Inputs: TypeAlias = Mapping[str, tuple[bool, ...]]
"""For each parameter of a routine, by its name in upper case, whether it is `:IN`."""

_FUNCTIONS_OF_VALUES = ("INV_POS", "ABS", "SQRT", "SIN", "COS", "ACOS", "TAN", "ATAN2")


@final
@dataclass(frozen=True)
class KrlFile(FileInPlace):
    """A `.src`, `.dat` or `.sub` file. Any bytes can be read; lines that are not understood are `Unknown` statements.

    Example:

        file = KrlFile.parse(Path("part.dat").read_bytes(), "part.dat")
        place = file.point("XP1").numbers["X"].span
        changed = file.replaced({place: "1000.25"})
    """

    @classmethod
    def parse(cls, data: bytes, name: str) -> KrlFile:
        """The file with these bytes. Raises nothing."""
        return cls(name, data)

    @cached_property
    def statements(self) -> tuple[Statement, ...]:
        """All statements and comments in the order of the file."""
        return statements(self.text)

    @cached_property
    def points(self) -> tuple[Point, ...]:
        """All points with their values: declared, assigned, or written in a motion."""
        return tuple(points_of(self.statements))

    @property
    def motions(self) -> tuple[Motion, ...]:
        """All motions."""
        return self.of(Motion)

    @property
    def unknown(self) -> tuple[Unknown, ...]:
        """The lines that are not understood."""
        return self.of(Unknown)

    def of(self, kind: type[Kind]) -> tuple[Kind, ...]:
        """The statements of one kind."""
        return tuple(statement for statement in self.statements if isinstance(statement, kind))

    @cached_property
    def declared(self) -> Mapping[str, Expression | None]:
        """Each declared variable by its name in upper case, also elements set in a data list (`BASE_DATA[1]`), with
        its value; None: without a value. Of one given twice, the first value.
        """
        found: dict[str, Expression | None] = {}
        for statement, in_data in with_data(self.statements):
            if isinstance(statement, Declaration):
                pairs = [(variable.target, variable.value) for variable in statement.variables]
            else:
                pairs = [(statement.target, statement.value)] if in_data and isinstance(statement, Assignment) else []
            for target, value in pairs:
                name = target.written if value is not None else target.name  # P[3] without a value: an array of three
                found.setdefault(name.upper(), value)
        return found

    def point(self, name: str) -> Point | None:
        """The point `name` of a data list or declaration; None if there is none, or if it is given twice."""
        return _only([point for point in self._points_by_name.get(name.upper(), ()) if point.declared])

    def frame_data(self, name: str) -> FrameData | None:
        """The FDAT `name`: TOOL_NO, BASE_NO; None where it is not declared with its values."""
        return FrameData.of(self.declared.get(name.upper()))

    def frame(self, name: str) -> Point | None:
        """The one value of `BASE_DATA[2]`, `TOOL_DATA[1]` or another FRAME, declared or assigned (`$config.dat`)."""
        return _only(self._points_by_name.get(name.upper(), []))

    @cached_property
    def _points_by_name(self) -> Mapping[str, list[Point]]:
        found = defaultdict[str, list[Point]](list)
        for point in self.points:
            found[point.key].append(point)
        return dict(found)

    def changes(self, name: str) -> tuple[Statement, ...]:
        """Statements that change the variable `name`, or may change it: assignments to it or a part of it, calls with
        it as an argument, control flow and lines not understood that name it. The values of a data list are none.
        """
        return tuple(self._changes.get(variable_of(name), ()))

    @cached_property
    def _changes(self) -> Mapping[str, list[Statement]]:
        found = defaultdict[str, list[Statement]](list)
        inputs: dict[str, tuple[bool, ...]] = dict.fromkeys(_FUNCTIONS_OF_VALUES, (True, True))
        inputs |= {begin.name.upper(): begin.inputs for begin in self.of(Begin)}
        for statement, in_data in with_data(self.statements):
            for variable in () if in_data else _changed_by(statement, inputs):
                found[variable].append(statement)
        return dict(found)

    def line_span(self, line: int) -> Span:
        """Place of a line (from 1), without its end."""
        return next(found.span for found in lines(self.text) if found.number == line)


def _only(found: list[Point]) -> Point | None:
    return found[0] if len(found) == 1 else None


def _changed_by(statement: Statement, inputs: _Inputs) -> set[str]:
    """The variables, upper case, that a statement changes or may change: arguments of a call may be OUT parameters."""
    match statement:
        case Assignment():
            return {statement.target.name.upper()} | _arguments(statement.value, inputs)
        case Invocation():
            return _arguments(statement.call, inputs)
        case Motion():
            return _arguments(statement.target, inputs) | _arguments(statement.auxiliary, inputs)
        case Control() | Unknown():
            return set(statement.names)
        case _:
            return set()


def _arguments(expression: Expression | None, inputs: _Inputs) -> set[str]:
    """The variables, upper case, in the arguments of all calls of an expression, except arguments that are `:IN`."""
    arguments = [
        argument
        for call in calls(expression)
        for argument, is_input in zip_longest(call.arguments, inputs.get(call.name.upper(), ()))
        if not is_input
    ]
    return {reference.name.upper() for argument in arguments for reference in references(argument)}
