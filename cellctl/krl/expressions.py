"""Values and expressions of KRL: numbers, names, aggregates, calls, operations. Operations are not evaluated."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeAlias, final

from cellctl.krl.tokens import Span


@final
@dataclass(frozen=True, slots=True)
class Number:
    """A number with its sign: `-90`, `+5`, `.5`, `1.0E-3`, `'B100011'`, `'H23'`. `span` covers the sign."""

    span: Span
    value: float


@final
@dataclass(frozen=True, slots=True)
class Literal:
    """A constant that is not a number: `"text"`, `#BASE`, `TRUE`. text: as written."""

    span: Span
    text: str


@final
@dataclass(frozen=True, slots=True)
class Reference:
    """A variable, a component or an element of it: `XP1`, `FP1.TOOL_NO`, `BASE_DATA[2]`, `TXT[]`, `P[I].X`.

    name: its variable as written. path: components (as written, with a dot) and indices after the name.
    """

    span: Span
    name: str
    path: tuple[str | tuple[Expression | None, ...], ...] = ()

    @property
    def key(self) -> str | None:
        """`BASE_DATA[2]`, `FP1.TOOL_NO` in upper case without white space; None if an index is not a number."""
        return self.written.upper() if self.certain else None

    @property
    def certain(self) -> bool:
        """Whether all indices are numbers."""
        return all(isinstance(item, Number | None) for part in self.path if isinstance(part, tuple) for item in part)

    @property
    def written(self) -> str:
        """The name with components and indices, without white space; `?` for an index that is not a number."""
        return self.name + "".join(part if isinstance(part, str) else f"[{_indices(part)}]" for part in self.path)


@final
@dataclass(frozen=True, slots=True)
class Field:
    """One component of an aggregate: `X 100.0`. label: upper case, `POINT2[]` with its brackets."""

    span: Span
    label: str
    value: Expression


@final
@dataclass(frozen=True, slots=True)
class Aggregate:
    """A structure written out: `{X 1.0,Y 2.0}`, `{E6POS: X 1.0}`. type: upper case, empty where none is written."""

    span: Span
    type: str
    fields: tuple[Field, ...]

    def field(self, label: str) -> Expression | None:
        """The value of the first component with this label (upper case)."""
        return next((field.value for field in self.fields if field.label == label), None)


@final
@dataclass(frozen=True, slots=True)
class Call:
    """A function or subprogram with its arguments; None for one left out: `SVEL_CP(0.1, , LCPDAT1)`."""

    span: Span
    name: str
    arguments: tuple[Expression | None, ...]


@final
@dataclass(frozen=True, slots=True)
class Operation:
    """Operands with operators before or between them, not evaluated: `XP1:OFFSET`, `XP1.Z+10`, `NOT $IN[1]`."""

    span: Span
    operators: tuple[str, ...]
    operands: tuple[Expression, ...]


Expression: TypeAlias = Number | Literal | Reference | Aggregate | Call | Operation


def _indices(items: tuple[Expression | None, ...]) -> str:
    texts = (f"{item.value:g}" if isinstance(item, Number) else "?" if item else "" for item in items)
    return ",".join(texts)


def references(expression: Expression | None) -> Iterator[Reference]:
    """All variables in an expression, also those of indices and arguments."""
    if isinstance(expression, Reference):
        yield expression
    for part in _parts(expression):
        yield from references(part)


def calls(expression: Expression | None) -> Iterator[Call]:
    """All calls in an expression, also those in arguments."""
    if isinstance(expression, Call):
        yield expression
    for part in _parts(expression):
        yield from calls(part)


def _parts(expression: Expression | None) -> list[Expression | None]:
    match expression:
        case Reference():
            return [item for part in expression.path if isinstance(part, tuple) for item in part]
        case Aggregate():
            return [field.value for field in expression.fields]
        case Call():
            return list(expression.arguments)
        case Operation():
            return list(expression.operands)
        case _:
            return []
