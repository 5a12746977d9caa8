"""The rules of the grammar for statements: one statement of a line, by recursive descent. `grammar` lists all rules."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeGuard, final, get_args

from cellctl.krl.expressions import Call, Expression
from cellctl.krl.reader import NotUnderstood, Reader
from cellctl.krl.statements import (
    Assignment,
    Begin,
    Control,
    Declaration,
    Declared,
    End,
    Invocation,
    Motion,
    MotionKind,
    Spline,
    Statement,
)
from cellctl.krl.tokens import Span, Token

_MOTIONS = frozenset(get_args(MotionKind))
_CIRCLES = frozenset({"CIRC", "SCIRC", "CIRC_REL", "SCIRC_REL"})
_CONTROL = frozenset(
    {
        "IF", "ELSE", "ENDIF", "FOR", "ENDFOR", "WHILE", "ENDWHILE", "REPEAT", "UNTIL", "LOOP", "ENDLOOP",
        "EXIT", "SWITCH", "CASE", "DEFAULT", "ENDSWITCH", "GOTO", "RETURN", "WAIT", "HALT", "CONTINUE",
        "INTERRUPT", "RESUME", "BRAKE", "TRIGGER", "SIGNAL", "CHANNEL", "STRUC", "ENUM", "EXT", "EXTFCT",
        "EXTP", "EXTFCTP", "IMPORT", "CONFIRM", "ANIN", "ANOUT", "DIGIN", "STOP", "CONST_VEL", "TIME_BLOCK",
        "ON_ERROR_PROCEED", "ASYSTOP", "ASYCONT", "ASYCANCEL"
    }
)  # fmt: skip
_BEFORE_TYPE = ("GLOBAL", "DECL", "CONST")


def names_of(found: Iterable[Token]) -> frozenset[str]:
    """All names among tokens, upper case."""
    return frozenset(token.word for token in found if token.kind == "name")


@final
class StatementRules:
    """The rules of statements on one line."""

    def __init__(self, reader: Reader, line: int, span: Span, in_spline: bool) -> None:
        self._reader = reader
        self._line = line
        self._span = span
        self._in_spline = in_spline

    def statement(self) -> Statement:
        """The statement. Raises NotUnderstood."""
        reader = self._reader
        if not reader.kinds("name"):
            raise NotUnderstood(f"no statement begins with '{reader.take().text}'")
        word = reader.word
        if _is_motion(word):
            return self._motion(word)
        if word in ("SPLINE", "PTP_SPLINE", "ENDSPLINE"):
            return self._spline(word)
        if word in ("END", "ENDFCT", "ENDDAT"):
            return End(self._line, self._span, reader.take().word)
        if word in _CONTROL:
            return self._control(word)
        if word in _BEFORE_TYPE or word in ("DEF", "DEFFCT", "DEFDAT") or reader.kinds("name", "name"):
            return self._declared()
        return self._assigned_or_called()

    def _control(self, keyword: str) -> Control:
        return Control(self._line, self._span, keyword, names_of(self._reader.rest()))

    def _declared(self) -> Statement:
        reader = self._reader
        before = set()
        while reader.word in _BEFORE_TYPE:
            before.add(reader.take().word)
        if reader.word in ("DEF", "DEFFCT", "DEFDAT"):
            return self._begin("GLOBAL" in before)
        if reader.word in _CONTROL:  # GLOBAL INTERRUPT DECL …, GLOBAL STRUC …
            return self._control(reader.word)
        kind = reader.name().word
        variables = [self._variable()]
        while reader.accept(","):
            variables.append(self._variable())
        return Declaration(self._line, self._span, kind, tuple(variables), "GLOBAL" in before)

    def _begin(self, is_global: bool) -> Begin:
        reader = self._reader
        keyword = reader.take().word
        if keyword == "DEFFCT":
            reader.reference()
        name = reader.name().text
        if keyword == "DEFDAT":
            reader.accept("PUBLIC")
            return Begin(self._line, self._span, keyword, name, is_global)
        reader.expect("(")
        inputs = () if reader.accept(")") else reader.listed(self._parameter, ")")
        return Begin(self._line, self._span, keyword, name, is_global, inputs)

    def _parameter(self) -> bool:
        self._reader.reference()
        return self._reader.accept(":") and self._reader.name().word == "IN"

    def _variable(self) -> Declared:
        target = self._reader.reference()
        return Declared(target, self._reader.expression() if self._reader.accept("=") else None)

    def _assigned_or_called(self) -> Statement:
        reader = self._reader
        after = reader.following
        if after == "(":
            called = reader.expression()
            if isinstance(called, Call):
                return Invocation(self._line, self._span, called)
            raise NotUnderstood("this is neither a call nor an assignment")
        if after == ":":
            return Control(self._line, self._span, ":", frozenset({reader.take().word, reader.take().word} - {":"}))
        return self._assignment()

    def _assignment(self) -> Assignment:
        target = self._reader.reference()
        self._reader.expect("=")
        value = self._reader.expression()
        return Assignment(self._line, Span(target.span.start, value.span.end), target, value)

    def _motion(self, kind: MotionKind) -> Motion:
        reader = self._reader
        reader.take()
        auxiliary: Expression | None = None
        angle: Expression | None = None
        target = reader.expression()
        if kind in _CIRCLES:
            reader.expect(",")
            auxiliary, target = target, reader.expression()
            if reader.accept(","):
                reader.expect("CA")
                angle = reader.expression()
        approximation, settings, reference = self._tail()
        return Motion(
            self._line, self._span, kind, target, auxiliary, angle, approximation, settings, reference, self._in_spline
        )

    def _tail(self) -> tuple[tuple[str, ...], tuple[Assignment, ...], str]:
        reader = self._reader
        approximation: list[str] = []
        settings: list[Assignment] = []
        reference = ""
        while reader.token is not None:
            if reader.kinds("enum"):
                reference = reader.take().word.replace(" ", "")
            elif reader.accept("WITH"):
                settings += self._assignments()
            elif reader.word.startswith("C_"):
                approximation.append(reader.take().word)
            else:
                reader.end()
        return tuple(approximation), tuple(settings), reference

    def _assignments(self) -> list[Assignment]:
        found = [self._assignment()]
        while self._reader.accept(","):
            found.append(self._assignment())
        return found

    def _spline(self, keyword: str) -> Spline:
        self._reader.take()
        _, settings, _ = self._tail()
        return Spline(self._line, self._span, keyword, settings)


def _is_motion(word: str) -> TypeGuard[MotionKind]:
    return word in _MOTIONS
