"""Statements of URScript, by recursive descent over the tokens of one logical line.

Source: Universal Robots, script manual, chapters "The URScript Programming Language" and "Module motion". A line that
is not understood becomes an `Unknown` with its reason, and the next line is read as if nothing had happened.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias, final

from cellctl.files import InputError, Problem
from cellctl.files.spans import Span
from cellctl.urscript._tokens import Token, logical_lines
from cellctl.urscript.expressions import Call, Elements, Expression, Name, Number, Other

_LEAVING = ("return", "break", "continue", "halt", "pass", "enter_critical", "exit_critical")
_WITH_EXPRESSION = ("kill", "join", "run", "return")
_KEYWORDS = frozenset(
    {*_LEAVING, *_WITH_EXPRESSION, "def", "thread", "sec", "if", "elif", "else", "while", "end", "global", "local"}
)
_BINARY = frozenset({"+", "-", "*", "/", "%", "==", "!=", "<", "<=", ">", ">=", "and", "or", "xor"})


@final
@dataclass(frozen=True, slots=True)
class Assignment:
    """`name = value`. element: of one element or member of the variable."""

    line: int
    span: Span
    name: str
    value: Expression
    element: bool = False


@final
@dataclass(frozen=True, slots=True)
class Evaluation:
    """An expression by itself: mostly a call. starts_thread: `run f()`."""

    line: int
    span: Span
    value: Expression
    starts_thread: bool = False


@final
@dataclass(frozen=True, slots=True)
class Leaving:
    """`return`, `break`, `continue`, `halt`; and `pass` and critical sections, which leave nothing."""

    line: int
    word: str
    value: Expression | None = None


@final
@dataclass(frozen=True, slots=True)
class Unknown:
    """A line that is not understood, and why. names: in it."""

    line: int
    reason: str
    names: frozenset[str]


@final
@dataclass(frozen=True, slots=True)
class Function:
    """`def`, `thread` or `sec` (kind) with its parameters."""

    line: int
    kind: str
    name: str
    parameters: tuple[str, ...]
    body: tuple[Statement, ...]


@final
@dataclass(frozen=True, slots=True)
class Branches:
    """`if` with its `elif` and `else`. has_else: one of the bodies is always executed."""

    line: int
    conditions: tuple[Expression, ...]
    bodies: tuple[tuple[Statement, ...], ...]
    has_else: bool


@final
@dataclass(frozen=True, slots=True)
class Loop:
    """`while`."""

    line: int
    condition: Expression
    body: tuple[Statement, ...]


Statement: TypeAlias = Assignment | Evaluation | Leaving | Unknown | Function | Branches | Loop


def statements(text: str, name: str) -> tuple[Statement, ...]:
    """The statements of a program. Raises InputError, naming the file, where blocks and their `end` do not match."""
    reader = _Blocks(list(logical_lines(text)), name)
    found = reader.body()
    if not reader.at_end:
        raise reader.problem("ends a block that was not begun", "remove it")
    return found


@final
class _Blocks:
    """Reads logical lines as blocks."""

    def __init__(self, lines: Sequence[list[Token]], name: str) -> None:
        self._lines, self._name = lines, name
        self._at = 0

    @property
    def at_end(self) -> bool:
        return self._at >= len(self._lines)

    def problem(self, what: str, cure: str) -> InputError:
        first = self._lines[min(self._at, len(self._lines) - 1)][0]
        return InputError(Problem(self._name, first.line, 0, f"'{first.text}' {what}", cure))

    def body(self) -> tuple[Statement, ...]:
        """Up to a word that ends or divides a block, which stays, or to the end of the file."""
        found: list[Statement] = []
        while not self.at_end and self._word not in ("end", "elif", "else"):
            found.append(self._statement())
        return tuple(found)

    @property
    def _word(self) -> str:
        return self._lines[self._at][0].text

    def _statement(self) -> Statement:
        tokens, word = self._lines[self._at], self._word
        self._at += 1
        if word in ("def", "thread", "sec"):
            return self._function(tokens)
        if word == "while":
            condition, start = self._condition(tokens), self._at
            body = self.body()
            self._end(start)
            return Loop(tokens[0].line, condition, body)
        if word == "if":
            return self._branches(tokens)
        return _simple(tokens)

    def _function(self, tokens: list[Token]) -> Function:
        words = [token.text for token in tokens if token.kind == "name"]
        start = self._at
        body = self.body()
        self._end(start)
        return Function(tokens[0].line, tokens[0].text, words[1] if len(words) > 1 else "", tuple(words[2:]), body)

    def _branches(self, tokens: list[Token]) -> Branches:
        start, line, has_else = self._at, tokens[0].line, False
        conditions, bodies = [self._condition(tokens)], [self.body()]
        while not self.at_end and self._word in ("elif", "else"):
            tokens = self._lines[self._at]
            self._at += 1
            if tokens[0].text == "elif":
                conditions.append(self._condition(tokens))
            else:
                has_else = True
            bodies.append(self.body())
        self._end(start)
        return Branches(line, tuple(conditions), tuple(bodies), has_else)

    def _condition(self, tokens: list[Token]) -> Expression:
        inner = tokens[1:-1] if tokens[-1].text == ":" else tokens[1:]
        try:
            return _Line(inner).whole()
        except _NotUnderstoodError:
            return Other(tokens[0].span, tuple(Name(token.span, token.text) for token in inner if token.kind == "name"))

    def _end(self, start: int) -> None:
        if self.at_end or self._word != "end":
            self._at = start - 1
            raise self.problem("begins a block without an end", "add 'end'")
        self._at += 1


class _NotUnderstoodError(Exception):
    """Why a line is not understood."""


def _simple(tokens: list[Token]) -> Statement:
    """A statement of one line."""
    first, span = tokens[0], Span(tokens[0].span.start, tokens[-1].span.end)
    try:
        if first.text in _LEAVING and len(tokens) == 1:
            return Leaving(first.line, first.text)
        if first.text == "return":
            return Leaving(first.line, first.text, _Line(tokens[1:]).whole())
        if first.text in _WITH_EXPRESSION:
            return Evaluation(first.line, span, _Line(tokens[1:]).whole(), starts_thread=first.text == "run")
        rest = tokens[1:] if first.text in ("global", "local") else tokens
        place = next((at for at, token in enumerate(rest) if token.text == "=" and not _inside(rest[:at])), None)
        if place is None:
            return Evaluation(first.line, span, _Line(rest).whole())
        if not place or rest[0].kind != "name" or rest[0].text in _KEYWORDS:
            raise _NotUnderstoodError("what is assigned has no name")
        target, value = rest[0].text, rest[place + 1 :]
        started = bool(value) and value[0].text == "run"
        read = _Line(value[1:] if started else value).whole()
        return Assignment(first.line, span, target, read, element=place > 1)
    except _NotUnderstoodError as error:
        return Unknown(first.line, str(error), frozenset(token.text for token in tokens if token.kind == "name"))


def _inside(tokens: Sequence[Token]) -> bool:
    """Whether a bracket is open behind these tokens."""
    return sum((token.text in "([{") - (token.text in ")]}") for token in tokens if token.kind == "sign") > 0


@final
class _Line:
    """Reads the tokens of one expression."""

    def __init__(self, tokens: Sequence[Token]) -> None:
        self._tokens = tokens
        self._at = 0

    def whole(self) -> Expression:
        """All tokens as one expression."""
        found = self._expression()
        if self._at < len(self._tokens):
            raise _NotUnderstoodError(f"'{self._tokens[self._at].text}' is not expected")
        return found

    def _text(self, ahead: int = 0) -> str:
        at = self._at + ahead
        return self._tokens[at].text if at < len(self._tokens) else ""

    def _next(self) -> Token:
        if self._at >= len(self._tokens):
            raise _NotUnderstoodError("it ends too early")
        self._at += 1
        return self._tokens[self._at - 1]

    def _take(self, sign: str) -> bool:
        taken = self._text() == sign
        self._at += taken
        return taken

    def _since(self, start: int) -> Span:
        return Span(self._tokens[start].span.start, self._tokens[self._at - 1].span.end)

    def _expression(self) -> Expression:
        """Operands between operators. Which binds first does not matter: nothing is evaluated."""
        start, parts = self._at, [self._operand()]
        while self._text() in _BINARY:
            self._at += 1
            parts.append(self._operand())
        return parts[0] if len(parts) == 1 else Other(self._since(start), tuple(parts))

    def _operand(self) -> Expression:
        start = self._at
        if self._text() in ("+", "-", "not"):
            sign = self._next().text
            found = self._operand()
            if isinstance(found, Number) and sign != "not":
                return Number(self._since(start), -found.value if sign == "-" else found.value)
            return Other(self._since(start), (found,))
        found = self._primary()
        while self._text() in ("[", "."):
            parts = [found]
            if self._next().text == "[":
                parts.append(self._expression())
                self._closed("]")
            else:
                self._next()
            found = Other(self._since(start), tuple(parts))
        return found

    def _primary(self) -> Expression:
        start, token = self._at, self._next()
        if token.kind == "number":
            hexadecimal = token.text.lower().startswith("0x")
            return Number(token.span, float(int(token.text, 16)) if hexadecimal else float(token.text))
        if token.text == "[":
            return Elements(*self._list(start), is_pose=False)
        if token.text == "p" and self._text() == "[" and self._is_pose():
            self._at += 1
            return Elements(*self._list(start), is_pose=True)
        if token.text == "(":
            inside = self._expression()
            self._closed(")")
            return Other(self._since(start), (inside,))
        if token.kind == "text":
            return Other(token.span, ())
        if token.kind != "name" or token.text in _KEYWORDS:
            raise _NotUnderstoodError(f"'{token.text}' is not expected")
        return self._call(start, token.text) if self._take("(") else Name(token.span, token.text)

    def _is_pose(self) -> bool:
        """`p[…]` with one part is an element of a variable p."""
        depth = commas = 0
        for token in self._tokens[self._at :]:
            depth += (token.text in "([") - (token.text in ")]") if token.kind == "sign" else 0
            commas += token.text == "," and depth == 1
            if not depth:
                break
        return commas > 0

    def _list(self, start: int) -> tuple[Span, tuple[Expression, ...]]:
        items: list[Expression] = []
        while not self._take("]"):
            if items:
                self._closed(",")
            items.append(self._expression())
        return self._since(start), tuple(items)

    def _call(self, start: int, name: str) -> Call:
        arguments: list[Expression] = []
        named: dict[str, Expression] = {}
        while not self._take(")"):
            if arguments or named:
                self._closed(",")
            if self._text(1) == "=":
                key = self._next().text
                self._at += 1
                named[key] = self._expression()
            else:
                arguments.append(self._expression())
        return Call(self._since(start), name, tuple(arguments), named)

    def _closed(self, sign: str) -> None:
        if not self._take(sign):
            raise _NotUnderstoodError(f"'{sign}' is missing")
