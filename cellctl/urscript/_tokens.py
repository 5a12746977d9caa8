"""A program as logical lines of tokens: a line ends where no bracket is open."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Literal, NamedTuple, TypeAlias

from cellctl.files.spans import Span

TokenKind: TypeAlias = Literal["name", "number", "text", "sign", "bad"]

_TOKEN = re.compile(
    r"""[ \t\r\f\v\ufeff]*
    (?:(?P<comment>\#[^\n]*)
    |(?P<line>\n)
    |(?P<number>0[xX][0-9a-fA-F]+|(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?)
    |(?P<name>[^\W\d]\w*)
    |(?P<text>"[^"\n]*"|'[^'\n]*')
    |(?P<sign><=|>=|==|!=|[-+*/%<>=()\[\]{},.:])
    |(?P<bad>.))""",
    re.VERBOSE,
)
_UTF8_MARK = "\xef\xbb\xbf"
_LABEL = re.compile(r"[ \t]*\$[^\n]*")
"""`$ 4 "Waypoint_1"`: the controller shows the node of the program tree; nothing is executed."""


class Token(NamedTuple):
    """One token and its place."""

    kind: TokenKind
    text: str
    span: Span
    line: int


def logical_lines(text: str) -> Iterator[list[Token]]:
    """The tokens of each statement's lines; comments, labels and empty lines are left out."""
    found: list[Token] = []
    at, line, depth = len(_UTF8_MARK) if text.startswith(_UTF8_MARK) else 0, 1, 0
    while at < len(text):
        if not found and (label := _LABEL.match(text, at)):
            at = label.end()
        match = _TOKEN.match(text, at)
        if match is None:  # white space at the end
            break
        kind, at = match.lastgroup, match.end()
        if kind == "line":
            line += 1
            if found and depth <= 0:
                yield found
                found, depth = [], 0
        elif kind != "comment":
            assert kind is not None
            token = Token(kind, match[kind], Span(*match.span(kind)), line)  # type: ignore[arg-type]
            found.append(token)
            depth += (token.text in "([{") - (token.text in ")]}") if kind == "sign" else 0
    if found:
        yield found
