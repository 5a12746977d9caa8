"""URScript, read: the statements that its words make. Unknown names and bad syntax are found here."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import final

from sims.ur._script_expressions import Binary, Constant, Expression, Index, ListOf, Name, PoseOf, ScriptError, Unary
from sims.ur._script_statements import (
    Call,
    Critical,
    Evaluate,
    Function,
    If,
    Leave,
    OfThread,
    Pass,
    RunThread,
    Statement,
    While,
    calls_of,
)
from sims.ur._script_words import OPENING, Word, words

KEYWORDS = (
    *OPENING, "end", "elif", "else", "return", "break", "continue", "global", "local", "run", "kill", "join",
    "enter_critical", "exit_critical", "pass", "halt", "and", "or", "xor", "not", "True", "False",
)  # fmt: skip
CONSTANTS = {"True": True, "False": False}


@final
@dataclass(frozen=True)
class Script:
    """A program. `secondary`: it runs beside another one, and takes no time of the robot."""

    name: str
    body: tuple[Statement, ...]
    functions: dict[str, Function]
    secondary: bool = False


@final
@dataclass(frozen=True, slots=True)
class Names:
    """Functions of the controller: `at_once`: those that take no time; `all_of`: with those that do."""

    at_once: Collection[str]
    all_of: Collection[str]


def parsed(text: str, names: Names) -> Script:
    """A whole program. Raises ScriptError."""
    return _Parser(text, names).script()


@final
class _Parser:
    def __init__(self, text: str, names: Names) -> None:
        self._lines = text.split("\n")
        self._words = [*words(text), Word("end", "\n", text.count("\n") + 1)]
        self._at = 0
        self._names = names
        self._functions: dict[str, Function] = {}
        self._top: list[tuple[str, str]] = []
        self._depth = 0
        self._own = {
            name.text for word, name in pairwise(self._words) if word.text in ("def", "thread") and name.kind == "name"
        }

    def script(self) -> Script:
        """A text that is one definition is that program; any other is executed line by line."""
        body = self._block(())
        found = list(self._functions.values())
        script = Script("unnamed", tuple(body), self._functions)
        if len(self._top) == 1 and all(isinstance(statement, Pass) for statement in body):
            kind, name = self._top[0]
            main = self._functions.pop(name)
            script = Script(name, main.body, self._functions, secondary=kind == "sec")
        known = {*self._names.all_of, *self._functions}
        for call in calls_of([function.body for function in found] + [script.body]):
            if call.name not in known:
                raise ScriptError(f"compile_error_name_not_found:{call.name}:", call.line)
        return script

    # statements

    def _block(self, until: Sequence[str]) -> list[Statement]:
        """Statements up to one of these words, which stays; up to the text's end without them."""
        found: list[Statement] = []
        while True:
            while self._here.kind == "end" and self._at < len(self._words) - 1:
                self._at += 1
            if self._at >= len(self._words) - 1:
                if until:
                    raise self._error()
                return found
            if self._here.kind == "name" and self._here.text in until:
                return found
            found.append(self._statement())

    def _statement(self) -> Statement:
        word = self._here
        simple: dict[str, Callable[[int], Statement]] = {
            "break": lambda line: Leave(line, "break"),
            "continue": lambda line: Leave(line, "continue"),
            "enter_critical": lambda line: Critical(line, enter=True),
            "exit_critical": lambda line: Critical(line, enter=False),
            "pass": Pass,
            "halt": lambda line: Evaluate(line, Call(line, "halt", (), {}, at_once=True)),
        }
        if word.kind != "name":
            raise self._error()
        if word.text in simple:
            self._at += 1
            return simple[word.text](word.line)
        if word.text in ("def", "thread", "sec"):
            return self._definition()
        if word.text == "if":
            return self._if()
        if word.text == "while":
            self._at += 1
            condition = self._header()
            block = self._block(("end",))
            self._at += 1
            return While(word.line, condition, block)
        if word.text in ("kill", "join"):
            self._at += 1
            return OfThread(word.line, self._expression(), word.text == "join")
        if word.text == "return":
            self._at += 1
            if self._here.kind == "end":
                return Leave(word.line, "return")
            return Evaluate(word.line, self._expression(), returns=True)
        return self._assignment_or_call()

    def _definition(self) -> Statement:
        kind = self._next()
        name = self._name()
        parameters: list[tuple[str, Expression | None]] = []
        self._sign("(")
        while not self._take(")"):
            if parameters:
                self._sign(",")
            parameter = self._name()
            parameters.append((parameter, self._expression() if self._take("=") else None))
        self._sign(":")
        if self._depth == 0:
            self._top.append((kind.text, name))
        self._depth += 1
        body = self._block(("end",))
        self._depth -= 1
        self._at += 1
        self._functions[name] = Function(name, tuple(parameters), tuple(body), kind.text == "thread")
        return Pass(kind.line)

    def _if(self) -> Statement:
        line = self._next().line
        branches = [(self._header(), self._block(("elif", "else", "end")))]
        otherwise: list[Statement] = []
        while (word := self._next()).text == "elif":
            branches.append((self._header(), self._block(("elif", "else", "end"))))
        if word.text == "else":
            self._sign(":")
            otherwise = self._block(("end",))
            self._at += 1
        return If(line, branches, otherwise)

    def _header(self) -> Expression:
        condition = self._expression()
        self._sign(":")
        return condition

    def _assignment_or_call(self) -> Statement:
        line, declared = self._here.line, ""
        if self._here.text in ("global", "local"):
            declared = self._next().text
        start = self._at
        if self._here.kind == "name" and self._here.text not in KEYWORDS:
            name = self._next().text
            index = None
            if self._take("["):
                index = self._expression()
                if not self._take("]"):
                    index = None
            if self._take("="):
                return Evaluate(line, self._expression(), name, index, declared)
            self._at = start
        if declared:
            raise self._error()
        return Evaluate(line, self._expression())

    # expressions, the weakest binding first

    def _expression(self) -> Expression:
        return self._binary(0)

    _LEVELS = (("or", "xor"), ("and",), ("==", "!=", "<", "<=", ">", ">="), ("+", "-"), ("*", "/", "%"))

    def _binary(self, level: int) -> Expression:
        if level == len(self._LEVELS):
            return self._unary()
        if level == 2:
            self._skip_ends()
        if level == 2 and self._here.text == "not":
            line = self._next().line
            return Unary(line, "not", self._binary(2))
        left = self._binary(level + 1)
        while self._here.text in self._LEVELS[level] and self._here.kind in ("sign", "name"):
            sign = self._next()
            left = Binary(sign.line, sign.text, left, self._binary(level + 1))
        return left

    def _unary(self) -> Expression:
        self._skip_ends()  # an operand may be on the next line; a statement ends where its grammar does
        word = self._here
        if word.kind == "sign" and word.text in "+-":
            self._at += 1
            operand = self._unary()
            return operand if word.text == "+" else Unary(word.line, "-", operand)
        if word.text == "not":
            self._at += 1
            return Unary(word.line, "not", self._unary())
        found = self._primary()
        while self._here.text == "[" and self._here.kind == "sign":
            self._at += 1
            found = Index(word.line, (found, self._expression()))
            self._sign("]")
        return found

    def _primary(self) -> Expression:
        word = self._next()
        if word.kind == "number":
            if word.text.startswith("0x"):
                return Constant(word.line, int(word.text, 16))
            return Constant(word.line, int(word.text) if word.text.isdigit() else float(word.text))
        if word.kind == "text":
            return Constant(word.line, word.text[1:-1])
        if word.text == "(":
            inside = self._expression()
            self._sign(")")
            return inside
        if word.text == "[":
            return ListOf(word.line, self._list())
        if word.kind != "name":
            self._at -= 1
            raise self._error()
        if word.text in CONSTANTS:
            return Constant(word.line, CONSTANTS[word.text])
        if word.text == "run":
            called = self._primary()
            if not isinstance(called, Call):
                raise self._error()
            return RunThread(word.line, called)
        if word.text in KEYWORDS:
            self._at -= 1
            raise self._error()
        if word.text == "p" and self._here.text == "[":
            return self._pose_or_element(word)
        if self._take("("):
            return self._call(word)
        return Name(word.line, word.text)

    def _pose_or_element(self, word: Word) -> Expression:
        """p[…] with six parts is a pose, with one an element of a variable of that name."""
        start = self._at
        self._at += 1
        parts = self._list()
        if len(parts) == 6:
            return PoseOf(word.line, parts)
        self._at = start
        return Name(word.line, word.text)

    def _list(self) -> list[Expression]:
        parts: list[Expression] = []
        while not self._take("]"):
            if parts:
                self._sign(",")
            self._skip_ends()
            parts.append(self._expression())
            self._skip_ends()
        return parts

    def _call(self, word: Word) -> Expression:
        positional: list[Expression] = []
        named: dict[str, Expression] = {}
        self._skip_ends()
        while not self._take(")"):
            if positional or named:
                self._sign(",")
                self._skip_ends()
            following = self._words[self._at + 1] if self._at + 1 < len(self._words) else self._here
            if self._here.kind == "name" and following.text == "=" and following.kind == "sign":
                name = self._next().text
                self._at += 1
                named[name] = self._expression()
            elif named:
                raise self._error()
            else:
                positional.append(self._expression())
            self._skip_ends()
        return Call(
            word.line,
            word.text,
            positional,
            named,
            at_once=word.text in self._names.at_once and word.text not in self._own,
        )

    # words

    @property
    def _here(self) -> Word:
        return self._words[min(self._at, len(self._words) - 1)]

    def _next(self) -> Word:
        word = self._here
        self._at += 1
        return word

    def _skip_ends(self) -> None:
        while self._here.kind == "end" and self._at < len(self._words) - 1:
            self._at += 1

    def _take(self, sign: str) -> bool:
        if self._here.kind == "sign" and self._here.text == sign:
            self._at += 1
            return True
        return False

    def _sign(self, sign: str) -> None:
        if not self._take(sign):
            raise self._error()

    def _name(self) -> str:
        if self._here.kind != "name" or self._here.text in KEYWORDS:
            raise self._error()
        return self._next().text

    def _error(self) -> ScriptError:
        line = self._here.line
        text = self._lines[line - 1] if line <= len(self._lines) else ""
        return ScriptError(f"syntax_error_on_line:{line}:{text}:", line)
