"""Strict YAML: no duplicate keys, no tags, no aliases, `on` is text; every value and error has its position."""

from __future__ import annotations

import pathlib
import re
from dataclasses import dataclass
from typing import Any, final

import yaml
from yaml.composer import Composer
from yaml.cyaml import CParser  # type: ignore[attr-defined]
from yaml.reader import ReaderError
from yaml.resolver import Resolver

from cellctl.files.kinds import kind_of, read_bytes, refuse_other_kind
from cellctl.files.problems import InputError, Problem

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


Path = tuple[str | int, ...]
"""The place of a value in a document: keys and list indices from the root, `("steps", 3, "speed")`."""

_PLAIN = (
    ("null", re.compile(r"~|null|Null|NULL|")),
    ("bool", re.compile(r"true|false|True|False|TRUE|FALSE")),
    ("int", re.compile(r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+")),
    ("float", re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")),
)
"""YAML 1.2 core schema: the type of an unquoted scalar is the first full match."""
_LONGEST_INTEGER = 300

_TAKEN_OTHERWISE = re.compile("[\t\r\x85\u2028\u2029\ufeff]")
"""Characters that libyaml and PyYAML take differently: tabs, other ends of lines, byte order marks."""


@final
@dataclass(frozen=True)
class Document:
    """A loaded file: plain Python values, the text that they came from, and each value's line and column."""

    file: str
    text: str
    data: Any
    marks: dict[Path, tuple[int, int]]
    keys: dict[Path, tuple[int, int]]

    def place(self, path: Path, *, key: bool = False) -> tuple[int, int]:
        """Line and column (from 1) of the value at `path`, or of its key; of the nearest parent if it is missing."""
        table = self.keys if key else self.marks
        while path and path not in table:
            path = path[:-1]
            table = self.marks
        return table.get(path, (1, 1))

    def problem(self, path: Path, what: str, cure: str = "", *, key: bool = False) -> Problem:
        """A problem at the place of the value (or key) at `path`."""
        line, column = self.place(path, key=key)
        return Problem(self.file, line, column, what, cure)


def load_yaml(path: pathlib.Path, wanted: str = "") -> Document:
    """Load a YAML file strictly. Raises InputError if it cannot be read, decoded or parsed, with all duplicates; and if
    it is certainly of another kind than `wanted` (of `cellctl.files.kinds`; empty: any).
    """
    data = read_bytes(path, wanted)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        cure = "save the file as UTF-8"
        line = data.count(b"\n", 0, error.start) + 1
        raise InputError(Problem(str(path), line, 0, f"is not UTF-8 text (byte {error.start})", cure)) from error
    if wanted:
        refuse_other_kind(path, wanted, kind_of(text))
    return parse_yaml(text, str(path))


def parse_yaml(text: str, file: str) -> Document:
    """Parse YAML `text` strictly; `file` names it in errors. Raises InputError."""
    reader = _Reader(file)
    try:
        data = reader.read(text)
    except yaml.MarkedYAMLError as error:
        raise InputError(Problem(file, *yaml_words(error))) from error
    except ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        what = f"a character that text does not hold (U+{error.character:04X})"
        raise InputError(Problem(file, line, 0, what, "remove it")) from error
    except RecursionError as error:
        raise InputError(Problem(file, 0, 0, "is nested too deeply to be meant", "check its brackets")) from error
    if reader.problems:
        raise InputError(reader.problems)
    return Document(file, text, data, reader.marks, reader.keys)


class _Strict(Composer):
    """Composes, and notes the aliases and tags, which the nodes do not contain."""

    def __init__(self) -> None:
        Composer.__init__(self)
        self.refused: list[tuple[int, int, str, str]] = []
        self.aliased = False

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        event: yaml.Event = self.peek_event()  # type: ignore[attr-defined]
        if isinstance(event, yaml.AliasEvent):
            self.aliased = True
            self._refuse(event, f"an alias (*{event.anchor}) is not allowed", "write the value out")
        elif tag := getattr(event, "tag", None):
            self._refuse(event, f"a tag ({tag.replace('tag:yaml.org,2002:', '!!')}) is not allowed", "remove it")
        return super().compose_node(parent, index)

    def _refuse(self, at: yaml.Node | yaml.Event, what: str, cure: str) -> None:
        self.refused.append((*_mark(at), what, cure))


class _FastLoader(_Strict, CParser, Resolver):
    """Events from libyaml: eight times as fast. It takes tabs that PyYAML refuses, and has other words for errors."""

    def __init__(self, text: str) -> None:
        CParser.__init__(self, text)
        _Strict.__init__(self)
        Resolver.__init__(self)


class _Loader(_Strict, yaml.SafeLoader):
    """Events from PyYAML, whose errors `_WORDS` knows."""

    def __init__(self, text: str) -> None:
        yaml.SafeLoader.__init__(self, text)
        _Strict.__init__(self)


class _Reader:
    def __init__(self, file: str) -> None:
        self.file = file
        self.marks: dict[Path, tuple[int, int]] = {}
        self.keys: dict[Path, tuple[int, int]] = {}
        self.problems: list[Problem] = []

    def read(self, text: str) -> Any:
        try:
            root, loader = _composed(_Loader if _TAKEN_OTHERWISE.search(text) else _FastLoader, text)
        except yaml.YAMLError:
            root, loader = _composed(_Loader, text)
        self.problems.extend(Problem(self.file, *refused) for refused in loader.refused)
        if root is None or loader.aliased:  # an alias may be a part of itself
            return None
        return self.value(root, ())

    def value(self, node: yaml.Node, path: Path) -> Any:
        self.marks[path] = _mark(node)
        if isinstance(node, yaml.MappingNode):
            return self._mapping(node, path)
        if isinstance(node, yaml.SequenceNode):
            return [self.value(child, (*path, index)) for index, child in enumerate(node.value)]
        return self._scalar(node)

    def _mapping(self, node: yaml.MappingNode, path: Path) -> dict[str, Any]:
        result: dict[str, Any] = {}
        for key_node, value_node in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                self._report(key_node, "a key has to be a plain word")
                continue
            key = key_node.value
            if key in result:
                first = self.keys[(*path, key)][0]
                self._report(key_node, f"'{key}' stands twice (first on line {first})", "remove one of them")
            self.keys.setdefault((*path, key), _mark(key_node))
            result[key] = self.value(value_node, (*path, key))
        return result

    def _scalar(self, node: yaml.Node) -> Any:
        text = str(node.value)
        if getattr(node, "style", None):  # quoted, or a block: always text
            return text
        kind = next((kind for kind, pattern in _PLAIN if pattern.fullmatch(text)), "")
        if kind == "int" and len(text) > _LONGEST_INTEGER:
            self._report(node, f"a whole number of {len(text)} digits cannot be meant")
            return None
        return _CONVERT[kind](text) if kind else text

    def _report(self, node: yaml.Node, what: str, cure: str = "") -> None:
        line, column = _mark(node)
        self.problems.append(Problem(self.file, line, column, what, cure))


def _composed(kind: type[_FastLoader] | type[_Loader], text: str) -> tuple[yaml.Node | None, _Strict]:
    loader = kind(text)
    try:
        return loader.get_single_node(), loader
    finally:
        loader.dispose()


_CONVERT: dict[str, Any] = {
    "null": lambda _: None,
    "bool": lambda text: text.lower() == "true",
    "int": lambda text: int(text, 0 if text.startswith(("0o", "0x")) else 10),
    "float": lambda text: float(re.sub(r"\.(?=[a-zA-Z])", "", text)),
}


def _mark(at: yaml.Node | yaml.Event) -> tuple[int, int]:
    mark = at.start_mark
    return (mark.line + 1, mark.column + 1) if mark else (0, 0)
