"""Expressions of URScript with their places in the text. They are read, not evaluated."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TypeAlias, final

from cellctl.files.spans import Span


@final
@dataclass(frozen=True, slots=True)
class Number:
    """A number, its sign included."""

    span: Span
    value: float


@final
@dataclass(frozen=True, slots=True)
class Name:
    """A variable."""

    span: Span
    text: str


@final
@dataclass(frozen=True, slots=True)
class Elements:
    """A list `[…]`, or a pose `p[…]`."""

    span: Span
    items: tuple[Expression, ...]
    is_pose: bool


@final
@dataclass(frozen=True, slots=True)
class Call:
    """A call of a function. named: arguments given as `name=…`."""

    span: Span
    name: str
    arguments: tuple[Expression, ...]
    named: Mapping[str, Expression] = field(default_factory=dict)

    def argument(self, place: int, name: str) -> Expression | None:
        """The argument at `place` (from 0), or that with this name; None where neither is given."""
        return self.arguments[place] if place < len(self.arguments) else self.named.get(name)


@final
@dataclass(frozen=True, slots=True)
class Other:
    """Anything else; parts: the expressions in it."""

    span: Span
    parts: tuple[Expression, ...]


Expression: TypeAlias = Number | Name | Elements | Call | Other


def within(expression: Expression) -> Iterator[Expression]:
    """The expression and all in it."""
    yield expression
    match expression:
        case Elements():
            parts: tuple[Expression, ...] = expression.items
        case Call():
            parts = (*expression.arguments, *expression.named.values())
        case Other():
            parts = expression.parts
        case _:
            parts = ()
    for part in parts:
        yield from within(part)


def calls(expression: Expression) -> Iterator[Call]:
    """All calls in it."""
    return (each for each in within(expression) if isinstance(each, Call))
