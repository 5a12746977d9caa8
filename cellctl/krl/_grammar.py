"""The grammar of KRL, as far as this package reads it: rules for statements, folds and the pendant's inline forms.

One statement a line; case is ignored. `[…]` optional, `{…}` repeated, `|` or; words in capitals and text in quotes are
terminal. The rules of statements are in `statement_rules`, those of expressions in `reader`.

    line        = [ statement ] [ comment ] | "&" text
    comment     = ";" text                                    folds and inline forms: `inline_forms`
    statement   = begin | end | declaration | assignment | motion | spline | call | label | control
    begin       = [ GLOBAL ] ( DEF name "(" parameters ")" | DEFFCT name name "(" parameters ")"
                | DEFDAT name [ PUBLIC ] )
    parameters  = [ reference ":" ( IN | OUT ) { "," … } ]
    end         = END | ENDFCT | ENDDAT
    declaration = { GLOBAL | DECL | CONST } name variable { "," variable }       without DECL too: INT I
    variable    = reference [ "=" expression ]
    assignment  = reference "=" expression
    motion      = ( PTP | LIN | SPTP | SLIN | SPL | PTP_REL | … ) expression tail
                | ( CIRC | SCIRC | CIRC_REL | … ) expression "," expression [ "," CA expression ] tail
    tail        = { C_PTP | C_DIS | C_VEL | C_ORI | C_SPL | "#BASE" | "#TOOL" | with }
    with        = WITH assignment { "," assignment }
    spline      = ( SPLINE | PTP_SPLINE ) [ with ] | ENDSPLINE { C_SPL | … }
    label       = name ":"
    control     = keyword { any token }                       brackets match; read, not interpreted
    expression  = operand { operator operand }
    operand     = { "+" | "-" | NOT | B_NOT } ( number | text | "#" name | "'B101'" | "'HFF'" | TRUE | FALSE
                | "(" expression ")" | aggregate | call | reference )
    aggregate   = "{" [ name ":" ] [ name [ "[" "]" ] expression { "," … } ] "}"
    call        = name "(" [ [ expression ] { "," [ expression ] } ] ")"
    reference   = name { "." name | "[" [ expression ] { "," [ expression ] } "]" }

Source: the language as described in KUKA's operating and programming instructions for system integrators (KSS 8.x),
chapters on variables, motions, splines and program execution control.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import TypeGuard, final, get_args

from cellctl.files.spans import Span
from cellctl.krl._expressions import Aggregate, Call, Expression, NotUnderstood, Reader
from cellctl.krl._tokens import Line, Token, lines, tokens
from cellctl.krl.statements import (
    Assignment,
    Begin,
    Comment,
    Control,
    Declaration,
    Declared,
    End,
    EndFold,
    Fold,
    Header,
    InlineForm,
    Invocation,
    Motion,
    MotionKind,
    Spline,
    Statement,
    Unknown,
)

_FOLD = re.compile(r";\s*FOLD\b\s*(?P<title>[^;]*)", re.IGNORECASE)
_END = re.compile(r";\s*ENDFOLD\b", re.IGNORECASE)
_FORM = re.compile(
    r"(?P<kind>PTP|SPTP|LIN|SLIN|SPL|(?P<circle>S?CIRC))\s+(?P<point>[\w$]+)(?(circle)\s+(?P<end>[\w$]+))"
    r"(?P<cont>\s+CONT)?\s+(?:VEL\s*=\s*(?P<velocity>[0-9.]+\s*(?:%|M/S))\s+)?(?P<data>(?!TOOL\[|BASE\[)\w+)?(?P<rest>.*)",
    re.IGNORECASE | re.DOTALL,
)
_FRAMES = re.compile(
    r"\b(?P<what>TOOL|BASE)\[\s*(?P<number>[0-9]{1,3})\s*\]\s*(?::(?P<name>.*?))?(?=\s*\bBASE\[|\s*\bTOOL\[|\s*$)",
    re.IGNORECASE | re.DOTALL,
)


def comment_statement(line: int, comment: Token) -> Comment | Fold | EndFold:
    """A comment as fold, end of a fold, or plain comment."""
    if _END.match(comment.text):
        return EndFold(line, comment.span)
    if found := _FOLD.match(comment.text):
        title = found["title"].strip()
        return Fold(line, comment.span, title, inline_form(title))
    return Comment(line, comment.span, comment.text[1:])


def inline_form(title: str) -> InlineForm | None:
    """The motion that a title shows; None without velocity, motion data and frame: `PTP to the table`."""
    found = _FORM.fullmatch(title)
    if found is None:
        return None
    frames = {frame["what"].upper(): frame for frame in _FRAMES.finditer(found["rest"])}
    if not (found["velocity"] or frames or "DAT" in (found["data"] or "").upper()):
        return None
    tool, base = frames.get("TOOL"), frames.get("BASE")
    return InlineForm(
        kind=found["kind"].upper(),
        points=(found["point"], *([found["end"]] if found["end"] else [])),
        approximated=found["cont"] is not None,
        data=found["data"] or "",
        tool=int(tool["number"]) if tool else None,
        tool_name=(tool["name"] or "").strip() if tool else "",
        base=int(base["number"]) if base else None,
        base_name=(base["name"] or "").strip() if base else "",
    )


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


def statements(text: str) -> tuple[Statement, ...]:
    """All statements and comments of `text`, in its order. A line that is not understood is `Unknown`."""
    found: list[Statement] = []
    in_spline = False
    for line in lines(text):
        for statement in _line(line, in_spline):
            if isinstance(statement, Spline | Begin | End):
                in_spline = isinstance(statement, Spline) and statement.keyword != "ENDSPLINE"
            found.append(statement)
    return tuple(found)


def aggregate_in(text: str, place: Span) -> Aggregate | None:
    """The first structure `{…}` at a place of a text, for lines that are no statements; None where there is none."""
    start = text.find("{", place.start, place.end)
    found = tokens(Line(0, Span(start, place.end), text[start : place.end])) if start >= 0 else []
    try:
        return Reader([token for token in found if token.kind != "comment"]).aggregate()
    except NotUnderstood:
        return None


def _line(line: Line, in_spline: bool) -> list[Statement]:
    code = line.text.strip()
    if code.startswith("&"):
        start = line.span.start + line.text.index("&")
        return [Header(line.number, Span(start, start + len(code)), code[1:])]
    found = tokens(line)
    comment = found.pop() if found and found[-1].kind == "comment" else None
    read = [_statement(line.number, found, in_spline)] if found else []
    return [*read, *([comment_statement(line.number, comment)] if comment else [])]


def _statement(line: int, found: Sequence[Token], in_spline: bool) -> Statement:
    span = Span(found[0].span.start, found[-1].span.end)
    try:
        reader = Reader(found)
        statement = StatementRules(reader, line, span, in_spline).statement()
        reader.end()
    except NotUnderstood as error:
        return Unknown(line, span, str(error), _assigned(found), names_of(found))
    return statement


def _assigned(found: Sequence[Token]) -> str:
    """The name before the first `=` of a line that is not understood, with its index."""
    places = [place for place, token in enumerate(found) if token.text == "="]
    before = list(found[: places[0]]) if places else []
    start = max((place for place, token in enumerate(before) if token.kind == "name"), default=len(before))
    return "".join(token.text for token in before[start:])
