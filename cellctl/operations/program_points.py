"""The points of a program's motions: where their numbers are written, and why some cannot be changed."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypeAlias, final

from cellctl.krl import (
    Aggregate,
    Assignment,
    Control,
    Declaration,
    Expression,
    Invocation,
    KrlFile,
    Motion,
    Point,
    Reference,
    Span,
    Statement,
    Unknown,
    point_of,
    references,
)

Part: TypeAlias = Literal["src", "dat"]


@final
@dataclass(frozen=True, slots=True)
class Written:
    """A point with its numbers in the program: `part` of it, and the point there."""

    part: Part
    point: Point

    @property
    def key(self) -> tuple[Part, Span]:
        """Its place, which is unique."""
        return self.part, self.point.span

    @property
    def name(self) -> str:
        """Its name; of one without, its line."""
        return self.point.name or f"the point in line {self.point.line}"


@final
class ProgramPoints:
    """Finds points. parts: the program, and its data list if there is one."""

    def __init__(self, parts: Mapping[Part, KrlFile]) -> None:
        self._parts, self._src = parts, parts["src"]

    def of(self, expression: Expression | None) -> Written | str:
        """The point of a motion, or why it is not one that can be changed."""
        if isinstance(expression, Reference):
            return self._named(expression)
        if not isinstance(expression, Aggregate):
            return "the point is computed"
        point = point_of(expression, self._src.text.count("\n", 0, expression.span.start) + 1)
        return _usable(Written("src", point)) if point else "not a point"

    def _named(self, reference: Reference) -> Written | str:
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
        return _usable(Written(*found[0]))

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


def _usable(written: Written) -> Written | str:
    point = written.point
    if point.fault:
        return f"{written.name}: {point.fault}"
    if point.missing:
        return f"{written.name} has no {', '.join(point.missing)}"
    moved = [label for label, value in point.values.items() if label[0] == "E" and abs(value) > 1e-9]
    return f"{written.name} moves the external axis {', '.join(moved)}" if moved else written


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
