"""The grammar of KRL, as far as this package reads it, and the statements of a text.

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

from collections.abc import Sequence

from cellctl.krl.expressions import Aggregate
from cellctl.krl.inline_forms import comment_statement
from cellctl.krl.reader import NotUnderstood, Reader
from cellctl.krl.statement_rules import StatementRules, names_of
from cellctl.krl.statements import Begin, End, Header, Spline, Statement, Unknown
from cellctl.krl.tokens import Line, Span, Token, lines, tokens


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
