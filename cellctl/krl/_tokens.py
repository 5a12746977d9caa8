"""Lines of a KRL file as tokens, each with its place in the text."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Literal, NamedTuple, TypeAlias

from cellctl.files.spans import Span

TokenKind: TypeAlias = Literal["name", "number", "string", "enum", "bits", "sign", "comment", "bad"]


class Token(NamedTuple):
    """One token and its place. word: the text in upper case, since KRL does not distinguish case."""

    kind: TokenKind
    text: str
    span: Span
    word: str


class Line(NamedTuple):
    """A line without its end. number: from 1."""

    number: int
    span: Span
    text: str


_TOKEN = re.compile(
    r"""[ \t\f\v\x1a\ufeff]*  # old editors end a file with 1A
    (?:(?P<comment>;.*)
    |(?P<name>(?:[^\W\d]|\$)[\w$]*)
    |(?P<number>(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?)
    |(?P<sign><=|>=|<>|==|[-+*/:<>=(),.\[\]{}])
    |(?P<string>"[^"]*")
    |(?P<enum>\#[ \t]*[^\W\d][\w$]*)
    |(?P<bits>'[ \t]*(?:[Bb][ \t]*[01]+|[Hh][ \t]*[0-9A-Fa-f]+)[ \t]*')
    |(?P<bad>".*|.)
    |\Z)""",
    re.VERBOSE | re.DOTALL,
)
_LINE = re.compile(r"([^\r\n]*)(\r\n|\r|\n|\Z)")
_UTF8_MARK = "\xef\xbb\xbf"


def lines(text: str) -> Iterator[Line]:
    """The lines of `text`: CR LF, CR or LF ends a line, also mixed."""
    at, number = 0, 0
    while at < len(text):
        found = _LINE.match(text, at)
        assert found is not None  # the pattern matches anywhere
        number += 1
        start = at + len(_UTF8_MARK) if at == 0 and text.startswith(_UTF8_MARK) else at
        yield Line(number, Span(start, found.end(1)), text[start : found.end(1)])
        at = found.end()


def tokens(line: Line) -> list[Token]:
    """The tokens of a line. A character that begins none is a token of kind `bad`."""
    found, by = [], line.span.start
    for match in _TOKEN.finditer(line.text):
        kind = match.lastgroup
        if kind is not None:  # None: white space at the end
            start, end = match.span(kind)
            text = match[kind]
            found.append(Token(kind, text, Span(by + start, by + end), text.upper()))  # type: ignore[arg-type]
    return found
