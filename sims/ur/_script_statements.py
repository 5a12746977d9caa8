"""Statements and calls of a URScript program, each of which can be executed: at once by `do`, or in time by `run`."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol, final

from sims.ur._script_expressions import (
    Expression,
    Frame,
    Running,
    ScriptError,
    Value,
    all_of,
    checked_bool,
    checked_index,
    copied,
    evaluated,
)


@final
@dataclass(frozen=True)
class Function:
    """`def` or `thread`: parameters, those with a default last, and body."""

    name: str
    parameters: tuple[tuple[str, Expression | None], ...]
    body: tuple[Statement, ...]
    thread: bool = False


@final
class Call:
    """A call of a function of the program, or of the controller."""

    def __init__(
        self, line: int, name: str, positional: Sequence[Expression], named: Mapping[str, Expression], *, at_once: bool
    ) -> None:
        self.line, self.name = line, name
        self.positional, self.named = tuple(positional), dict(named)
        self.blocks = not at_once or any(part.blocks for part in (*positional, *named.values()))

    def value(self, frame: Frame) -> Value:
        values = [part.value(frame) for part in self.positional]
        named = {name: part.value(frame) for name, part in self.named.items()}
        return frame.machine.builtin(self.name, values, named, self.line)

    def run(self, frame: Frame) -> Running:
        values = yield from all_of(self.positional, frame)
        named = {}
        for name, part in self.named.items():
            named[name] = yield from evaluated(part, frame)
        function = frame.machine.functions.get(self.name)
        if function is None:
            result = frame.machine.builtin(self.name, values, named, self.line)
            if isinstance(result, Generator):
                try:
                    result = yield from result
                except ScriptError as error:
                    error.line = error.line or self.line
                    raise
                except (TypeError, ValueError, IndexError, OverflowError) as error:
                    raise ScriptError(f"Type error: {self.name}: {error}", self.line) from None
            return result
        return (yield from called(function, values, named, frame, self.line))


def called(function: Function, values: Sequence[Value], named: Mapping[str, Value], frame: Frame, line: int) -> Running:
    """Execute a function of the program, in a scope of its own."""
    inner = Frame(frame.machine, frame.thread, frame.outer or frame)
    names = [name for name, _ in function.parameters]
    if len(values) > len(names) or set(named) - set(names[len(values) :]):
        raise ScriptError(f"Wrong arguments of {function.name}", line)
    inner.names.update(zip(names, map(copied, values), strict=False))
    inner.names.update({name: copied(value) for name, value in named.items()})
    for name, default in function.parameters:
        if name not in inner.names:
            if default is None:
                raise ScriptError(f"{function.name} needs its argument {name}", line)
            inner.names[name] = yield from evaluated(default, frame)
    yield from frame.machine.spend(frame.thread)
    ended = yield from execute(function.body, inner)
    return ended.result if ended else None


@final
class RunThread:
    """`run f()`: the thread's number."""

    blocks = True

    def __init__(self, line: int, call: Call) -> None:
        self.line, self._call = line, call

    def value(self, frame: Frame) -> Value:
        raise NotImplementedError

    def run(self, frame: Frame) -> Running:
        yield from ()
        return frame.machine.start_thread(self._call.name, frame.outer or frame, self.line)


@final
@dataclass(frozen=True, slots=True)
class Ended:
    """How a block ended before its end: `break`, `continue` or `return`."""

    how: str
    result: Value = None


class Statement(Protocol):
    """A line of a program."""

    line: int
    blocks: bool

    def do(self, frame: Frame) -> Ended | None:
        """Execute it at once."""

    def run(self, frame: Frame) -> Generator[None, None, Ended | None]:
        """Execute it in time."""


def execute(block: Sequence[Statement], frame: Frame) -> Generator[None, None, Ended | None]:
    """One statement after the other. Raises ScriptError."""
    for statement in block:
        frame.thread.line = statement.line
        ended = (yield from statement.run(frame)) if statement.blocks else statement.do(frame)
        if ended:
            return ended
    return None


class _AtOnce:
    """A statement that takes no time."""

    line = 0
    blocks = False

    def do(self, frame: Frame) -> Ended | None:
        raise NotImplementedError

    def run(self, frame: Frame) -> Generator[None, None, Ended | None]:
        yield from ()
        return self.do(frame)


@final
class Evaluate:
    """An expression whose value goes nowhere, or a variable, or an element of one; or is the function's result."""

    def __init__(
        self,
        line: int,
        expression: Expression,
        target: str = "",
        index: Expression | None = None,
        declared: str = "",
        *,
        returns: bool = False,
    ) -> None:
        self.line, self._expression = line, expression
        self._target, self._index, self._declared, self._returns = target, index, declared, returns
        self.blocks = expression.blocks or bool(index and index.blocks)

    def do(self, frame: Frame) -> Ended | None:
        index = self._index.value(frame) if self._index else None
        return self._take(frame, self._expression.value(frame), index)

    def run(self, frame: Frame) -> Generator[None, None, Ended | None]:
        index = (yield from evaluated(self._index, frame)) if self._index else None
        return self._take(frame, (yield from evaluated(self._expression, frame)), index)

    def _take(self, frame: Frame, value: Value, index: Value) -> Ended | None:
        if self._returns:
            return Ended("return", value)
        if self._target and self._index:
            of = frame.get(self._target, self.line)
            of[checked_index(of, index, self.line)] = copied(value)
        elif self._target:
            frame.scope_of(self._target, self._declared)[self._target] = copied(value)
        return None


@final
class Leave(_AtOnce):
    """`break`, `continue`, or `return` without a value."""

    def __init__(self, line: int, how: str) -> None:
        self.line, self._ended = line, Ended(how)

    def do(self, frame: Frame) -> Ended | None:
        return self._ended


@final
class Critical(_AtOnce):
    """`enter_critical`, `exit_critical`: no other thread runs in between."""

    def __init__(self, line: int, *, enter: bool) -> None:
        self.line, self._enter = line, enter

    def do(self, frame: Frame) -> Ended | None:
        frame.thread.critical = self._enter
        return None


@final
class Pass(_AtOnce):
    """`pass`, and a definition, which has been taken when the program was read."""

    def __init__(self, line: int) -> None:
        self.line = line

    def do(self, frame: Frame) -> Ended | None:
        return None


@final
@dataclass
class If:
    """`branches`: conditions, each with its block; `otherwise`: of `else`."""

    line: int
    branches: Sequence[tuple[Expression, Sequence[Statement]]]
    otherwise: Sequence[Statement]
    blocks: bool = field(default=True, init=False)

    def do(self, frame: Frame) -> Ended | None:
        raise NotImplementedError

    def run(self, frame: Frame) -> Generator[None, None, Ended | None]:
        for condition, block in self.branches:
            if checked_bool((yield from evaluated(condition, frame)), condition.line):
                return (yield from execute(block, frame))
        return (yield from execute(self.otherwise, frame))


@final
@dataclass
class While:
    """A loop. One that only computes gets its share of each cycle."""

    line: int
    condition: Expression
    block: Sequence[Statement]
    blocks: bool = field(default=True, init=False)

    def do(self, frame: Frame) -> Ended | None:
        raise NotImplementedError

    def run(self, frame: Frame) -> Generator[None, None, Ended | None]:
        while checked_bool((yield from evaluated(self.condition, frame)), self.line):
            yield from frame.machine.spend(frame.thread)
            ended = yield from execute(self.block, frame)
            if ended and ended.how != "continue":
                return ended if ended.how == "return" else None
            frame.thread.line = self.line
        return None


@final
@dataclass
class OfThread:
    """`kill` and `join`."""

    line: int
    expression: Expression
    join: bool
    blocks: bool = field(default=True, init=False)

    def do(self, frame: Frame) -> Ended | None:
        raise NotImplementedError

    def run(self, frame: Frame) -> Generator[None, None, Ended | None]:
        number = yield from evaluated(self.expression, frame)
        if not self.join:
            frame.machine.kill(number)
            return None
        while frame.machine.alive(number):
            yield
        return None


def calls_of(part: object) -> Iterator[Call]:
    """Every call in a statement, an expression or a block."""
    if isinstance(part, Call):
        yield part
    if isinstance(part, (list, tuple)):
        for one in part:
            yield from calls_of(one)
    elif isinstance(part, dict):
        yield from calls_of(list(part.values()))
    elif hasattr(part, "__dict__"):
        yield from calls_of(list(vars(part).values()))
