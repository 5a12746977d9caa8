"""Error messages for invalid YAML in our own words, without the parser's terms."""

from __future__ import annotations

import re

import yaml

_QUOTE_IT = "put the value in quotes"
_INDENT = "indent it by spaces as the lines beside it, and check the line before"
_WORDS: tuple[tuple[str, str, str], ...] = (
    (
        "mapping values are not",
        "a second ': ' in one line, or a line indented too far",
        _QUOTE_IT + ", or mend the indent",
    ),
    ("could not find expected ':'", "a key without its colon", "write `key: value`"),
    (r"found character '\\t'", "a tab stands where only spaces can", "indent by spaces"),
    ("found character (.+) that cannot start", "a value cannot begin with {found}", _QUOTE_IT),
    ("found unexpected end of stream|found unexpected doc", "a quote is opened and not closed", "close it"),
    ("found unknown escape|expected escape", "a backslash before a letter that has none", "use single quotes"),
    (
        r"expected ',' or '\]'",
        "a list in [ ] is not closed, or misses a comma",
        "close it with ], and check its commas",
    ),
    (
        "expected ',' or '}'",
        "a mapping in { } is not closed, or misses a comma",
        "close it with }, and check its commas",
    ),
    ("expected <block end>", "this line does not belong to the lines before it", _INDENT),
    ("expected '<document start>'", "text stands after the end of the content", _INDENT),
    ("expected the node content", "a value is missing here", "write a value; put special characters in quotes"),
    ("expected a single document", "a second document begins here (---)", "write one document in a file"),
    (
        "expected alpha|found undefined alias|found duplicate anchor",
        "'*' and '&' have a meaning of their own",
        _QUOTE_IT,
    ),
    ("found undefined tag handle|expected '[!>]'|expected URI", "'!' has a meaning of its own", _QUOTE_IT),
    ("sequence entries are not", "a list item ('- ') cannot stand here", "begin the list on a line of its own"),
)
"""The beginning of a text of PyYAML (6.0: its scanner, parser and composer), what is wrong, and the cure."""

_OPENED = ("found unexpected end of stream",)
"""Texts that are reported at the opening place, not at the end of the file."""


def yaml_words(error: yaml.MarkedYAMLError) -> tuple[int, int, str, str]:
    """Line and column (from 1; 0: unknown), what is wrong, and the cure."""
    text = f"{error.problem}; {error.context}"
    opened = error.context_mark if error.problem in _OPENED else None
    mark = opened or error.problem_mark or error.context_mark
    line, column = (mark.line + 1, mark.column + 1) if mark else (0, 0)
    for pattern, what, cure in _WORDS:
        if found := re.search(pattern, text):
            what = what.replace("{found}", "".join(found.groups()))
            return line, column, _with_beginning(what, error, line), cure
    return line, column, "this is not YAML", "check indentation, colons and quotes here"


def _with_beginning(what: str, error: yaml.MarkedYAMLError, line: int) -> str:
    """`what`, with the first line of the list or mapping if that differs."""
    began = error.context_mark.line + 1 if error.context_mark and "is not closed" in what else line
    return what if began == line else f"{what} (it begins on line {began})"
