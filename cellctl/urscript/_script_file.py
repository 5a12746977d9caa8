"""A script file: its bytes, its statements, and the same bytes with a few places changed."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import final

from cellctl.files.spans import FileInPlace, Span
from cellctl.urscript._grammar import Assignment, Branches, Function, Loop, Statement, Unknown, statements
from cellctl.urscript.expressions import Expression


@final
@dataclass(frozen=True)
class ScriptFile(FileInPlace):
    """A `.script` file."""

    @cached_property
    def statements(self) -> tuple[Statement, ...]:
        """The statements in blocks. Raises InputError where blocks and their `end` do not match."""
        return statements(self.text, self.name)

    @cached_property
    def functions(self) -> Mapping[str, Function]:
        """All functions and threads by their name; of two with one name, the last."""
        return {each.name: each for each in every(self.statements) if isinstance(each, Function)}

    @cached_property
    def values(self) -> Mapping[str, Expression | None]:
        """The variables that are assigned once, with their values; None for a variable that has none for certain: one
        that is assigned again or by elements, is a parameter, or stands in a line that is not understood.
        """
        found: dict[str, list[Expression | None]] = defaultdict(list)
        for each in every(self.statements):
            match each:
                case Assignment():
                    found[each.name].append(None if each.element else each.value)
                case Function():
                    for parameter in each.parameters:
                        found[parameter].append(None)
                case Unknown():
                    for name in each.names:
                        found[name].append(None)
                case _:
                    pass
        return {name: values[0] if len(values) == 1 else None for name, values in found.items()}

    def line_of(self, span: Span) -> int:
        """The line (from 1) in which a place begins."""
        return self.text.count("\n", 0, span.start) + 1


def every(body: Sequence[Statement]) -> Iterator[Statement]:
    """All statements of a body and of the blocks in it."""
    for statement in body:
        yield statement
        match statement:
            case Function() | Loop():
                yield from every(statement.body)
            case Branches():
                for inner in statement.bodies:
                    yield from every(inner)
            case _:
                pass
