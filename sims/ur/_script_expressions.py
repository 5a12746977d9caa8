"""Values, variables and expressions of a URScript program, each of which can be executed.

Where executing a part may take time of the robot, `blocks` is set, and `run` is a generator that yields once for each
cycle of the controller; anything else is done at once by `value`. So a cycle of a program that only computes costs no
generators.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Generator, Mapping, Sequence
from typing import Any, Protocol, TypeAlias, final

Value = Any
"""bool, int, float, str, None, a list of values, or a PoseValue."""
Running: TypeAlias = Generator[None, None, Value]


class ScriptError(Exception):
    """The program cannot be compiled or go on; the text is the controller's. `line`: from 1; 0: not known."""

    def __init__(self, text: str, line: int = 0) -> None:
        super().__init__(text)
        self.text, self.line = text, line


class Halt(Exception):
    """`halt`: the program ends."""


@final
class PoseValue(list[float]):
    """p[x, y, z, rx, ry, rz]."""


def copied(value: Value) -> Value:
    """Lists are values: an assignment copies them."""
    if isinstance(value, PoseValue):
        return PoseValue(value)
    return [copied(part) for part in value] if isinstance(value, list) else value


def shown(value: Value) -> str:
    """As `textmsg` and `to_str` write it."""
    if isinstance(value, bool):
        return str(value)
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, list):
        text = ", ".join(shown(part) for part in value)
        return f"p[{text}]" if isinstance(value, PoseValue) else f"[{text}]"
    return "" if value is None else str(value)


@final
class Thread:
    """`number`: what `run` gives; `line`: where it is; `critical`: no other thread may run."""

    def __init__(self, number: int) -> None:
        self.number, self.line, self.spent = number, 0, 0
        self.critical = False
        self.running: Running | None = None


class Runner(Protocol):
    """What executes the program."""

    functions: Mapping[str, Any]

    def builtin(self, name: str, values: Sequence[Value], named: Mapping[str, Value], line: int) -> Value:
        """Call a function of the controller. Raises ScriptError."""

    def spend(self, thread: Thread) -> Running:
        """A loop or a call uses some of a thread's time."""

    def start_thread(self, name: str, program: Frame, line: int) -> int:
        """Start a thread of the program; its number. Raises ScriptError."""

    def kill(self, number: Value) -> None:
        """End a thread."""

    def alive(self, number: Value) -> bool:
        """Whether a thread is still there."""


@final
class Frame:
    """Variables of a function that runs, in the scope of its program."""

    __slots__ = ("machine", "names", "outer", "thread")

    def __init__(self, machine: Runner, thread: Thread, outer: Frame | None) -> None:
        self.machine, self.thread, self.outer = machine, thread, outer
        self.names: dict[str, Value] = {}

    def get(self, name: str, line: int) -> Value:
        """The value of a variable. Raises ScriptError."""
        if name in self.names:
            return self.names[name]
        if self.outer and name in self.outer.names:
            return self.outer.names[name]
        raise ScriptError(f"compile_error_name_not_found:{name}:", line)

    def scope_of(self, name: str, declared: str) -> dict[str, Value]:
        """Where an assignment goes: to the program's variable of that name, where there is one, else to this scope."""
        if not self.outer or declared == "local" or (not declared and name in self.names):
            return self.names
        return self.outer.names if declared == "global" or name in self.outer.names else self.names


class Expression(Protocol):
    """A part with a value."""

    line: int
    blocks: bool

    def value(self, frame: Frame) -> Value:
        """Its value, where it does not block. Raises ScriptError."""

    def run(self, frame: Frame) -> Running:
        """Its value, in time. Raises ScriptError."""


def evaluated(expression: Expression, frame: Frame) -> Running:
    """The value of any expression."""
    if expression.blocks:
        return (yield from expression.run(frame))
    return expression.value(frame)


def all_of(expressions: Sequence[Expression], frame: Frame) -> Generator[None, None, list[Value]]:
    found = []
    for expression in expressions:
        value = yield from evaluated(expression, frame)
        found.append(value)
    return found


class _Compound:
    """An expression made of others: it works their values into its own."""

    def __init__(self, line: int, parts: Sequence[Expression]) -> None:
        self.line, self.parts = line, tuple(parts)
        self.blocks = any(part.blocks for part in parts)

    def made(self, values: list[Value]) -> Value:
        raise NotImplementedError

    def value(self, frame: Frame) -> Value:
        return self.made([part.value(frame) for part in self.parts])

    def run(self, frame: Frame) -> Running:
        return self.made((yield from all_of(self.parts, frame)))


@final
class Constant:
    """A number, a text, True or False."""

    blocks = False

    def __init__(self, line: int, constant: Value) -> None:
        self.line, self._constant = line, constant

    def value(self, frame: Frame) -> Value:
        return self._constant

    def run(self, frame: Frame) -> Running:
        yield from ()
        return self._constant


@final
class Name:
    """A variable."""

    blocks = False

    def __init__(self, line: int, name: str) -> None:
        self.line, self.name = line, name

    def value(self, frame: Frame) -> Value:
        return frame.get(self.name, self.line)

    def run(self, frame: Frame) -> Running:
        yield from ()
        return self.value(frame)


@final
class ListOf(_Compound):
    """[1, 2, 3]."""

    def made(self, values: list[Value]) -> Value:
        return values


@final
class PoseOf(_Compound):
    """p[x, y, z, rx, ry, rz]."""

    def made(self, values: list[Value]) -> Value:
        if any(isinstance(value, bool) or not isinstance(value, (int, float)) for value in values):
            raise ScriptError("Type error: a pose has six numbers", self.line)
        return PoseValue(float(value) for value in values)


@final
class Index(_Compound):
    """list[i]."""

    def made(self, values: list[Value]) -> Value:
        of, index = values
        return of[checked_index(of, index, self.line)]


def checked_index(of: Value, index: Value, line: int) -> int:
    """`index`, where `of` has it. Raises ScriptError."""
    if not isinstance(of, list) or isinstance(index, bool) or not isinstance(index, int):
        raise ScriptError("Type error: a list and a whole number are expected", line)
    if not 0 <= index < len(of):
        raise ScriptError(f"Index out of bounds: {index} of {len(of)}", line)
    return index


def _number(value: Value) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def checked_bool(value: Value, line: int) -> bool:
    if not isinstance(value, bool):
        raise ScriptError("Type error: a boolean is expected", line)
    return value


ARITHMETIC: Mapping[str, Callable[[Any, Any], Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "%": operator.mod,
}
ORDER: Mapping[str, Callable[[Any, Any], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
LOGIC = ("and", "or", "xor")


@final
class Binary(_Compound):
    """Two operands and what is between them."""

    def __init__(self, line: int, sign: str, left: Expression, right: Expression) -> None:
        super().__init__(line, (left, right))
        self._sign, self._left, self._right = sign, left, right

    def value(self, frame: Frame) -> Value:
        return self._of(self._left.value(frame), self._right.value(frame))

    def made(self, values: list[Value]) -> Value:
        return self._of(*values)

    def _of(self, a: Value, b: Value) -> Value:
        sign = self._sign
        if type(a) is type(b) is float and sign in "+-*":  # most of what a program computes in each cycle
            return ARITHMETIC[sign](a, b)
        if sign in ("==", "!="):
            return (a == b) == (sign == "==")
        if sign in LOGIC:
            left, right = checked_bool(a, self.line), checked_bool(b, self.line)
            return left and right if sign == "and" else left or right if sign == "or" else left != right
        if not (_number(a) and _number(b)):
            raise ScriptError(f"Type error: '{sign}' is of two numbers", self.line)
        if sign in ORDER:
            return ORDER[sign](a, b)
        if sign in "/%" and b == 0:
            raise ScriptError("Division by zero", self.line)
        return ARITHMETIC[sign](a, b)


@final
class Unary(_Compound):
    """`not`, or a minus."""

    def __init__(self, line: int, sign: str, operand: Expression) -> None:
        super().__init__(line, (operand,))
        self._sign = sign

    def made(self, values: list[Value]) -> Value:
        if self._sign == "not":
            return not checked_bool(values[0], self.line)
        if not _number(values[0]):
            raise ScriptError("Type error: a number is expected", self.line)
        return -values[0]
