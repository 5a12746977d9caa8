"""Lines of a KRL file as tokens, each with its place in the text."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Literal, NamedTuple, TypeAlias

TokenKind: TypeAlias = Literal["name", "number", "string", "enum", "bits", "sign", "comment", "bad"]


class Span(NamedTuple):
    """A place in a file: characters `start` up to `end`, not included, counted from 0.

    A file is read as Latin-1: one character is one byte, so a span of `KrlFile` counts bytes.
    """

    start: int
    end: int


class Token(NamedTuple):
    """One token and its place."""

    kind: TokenKind
    text: str
    span: Span

    @property
    def word(self) -> str:
        """The text in upper case: KRL does not distinguish case."""
        return self.text.upper()


class Line(NamedTuple):
    """A line without its end. number: from 1."""

    number: int
    span: Span
    text: str


_TOKEN = re.compile(
    r"""(?P<comment>;.*)
    |(?P<string>"[^"]*")
    |(?P<bits>'[ \t]*(?:[Bb][ \t]*[01]+|[Hh][ \t]*[0-9A-Fa-f]+)[ \t]*')
    |(?P<number>(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?)
    |(?P<enum>\#[ \t]*[^\W\d][\w$]*)
    |(?P<name>(?:[^\W\d]|\$)[\w$]*)
    |(?P<sign><=|>=|<>|==|[-+*/:<>=(),.\[\]{}])
    |(?P<bad>".*|.)""",
    re.VERBOSE | re.DOTALL,
)
_SPACE = re.compile(r"[ \t\f\v\x1a\ufeff]*")  # old editors end a file with 1A
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
    found, at = [], 0
    while (at := _after_space(line.text, at)) < len(line.text):
        match = _TOKEN.match(line.text, at)
        assert match is not None  # `bad` matches anything
        found.append(Token(match.lastgroup, match[0], _moved(match.span(), line.span.start)))  # type: ignore[arg-type]
        at = match.end()
    return found


def _after_space(text: str, at: int) -> int:
    space = _SPACE.match(text, at)
    return space.end() if space else at


def _moved(span: tuple[int, int], by: int) -> Span:
    return Span(span[0] + by, span[1] + by)
