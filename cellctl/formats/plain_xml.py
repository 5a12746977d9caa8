"""XML as data files use it: elements, attributes, the line of each. A DTD, and so every entity bomb, is refused."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn, final
from xml.parsers import expat

from cellctl.files import InputError, Problem

LARGEST_BYTES = 20_000_000


@final
@dataclass(frozen=True, slots=True)
class Element:
    """An element: its name, attributes, children in order, and the line (from 1) on which it begins."""

    tag: str
    attributes: dict[str, str]
    line: int
    children: list[Element] = field(default_factory=list)

    def each(self, tag: str) -> Iterator[Element]:
        """The children of this name."""
        return (child for child in self.children if child.tag == tag)

    def first(self, tag: str) -> Element | None:
        """The first child of this name."""
        return next(self.each(tag), None)


def load_xml(path: Path) -> Element:
    """The root element of a file. Raises InputError where it cannot be read, is no XML, or declares a DTD."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(Problem(str(path), 0, 0, f"cannot be read: {error.strerror}", "check the path")) from error
    if len(data) > LARGEST_BYTES:
        raise InputError(Problem(str(path), 0, 0, f"is too large ({len(data)} bytes)", "meshes belong in other files"))
    return parse_xml(data, str(path))


def parse_xml(data: bytes, file: str) -> Element:
    """The root element of `data`; `file` names it in errors. Raises InputError."""
    builder = _Builder(file)
    try:
        builder.parser.Parse(data, True)
    except expat.ExpatError as error:
        what = f"is not XML here: {expat.errors.messages[error.code]}"
        raise InputError(Problem(file, error.lineno, error.offset + 1, what, "check the tags and quotes")) from error
    except (LookupError, ValueError) as error:  # an encoding that nobody knows
        raise InputError(Problem(file, 1, 0, f"is not XML: {error}", "save the file as UTF-8")) from error
    return builder.root.children[0]


class _Builder:
    def __init__(self, file: str) -> None:
        self.file = file
        self.root = Element("", {}, 0)
        self._open = [self.root]
        self.parser = expat.ParserCreate()
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.StartDoctypeDeclHandler = self._doctype

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        element = Element(tag, attributes, self.parser.CurrentLineNumber)
        self._open[-1].children.append(element)
        self._open.append(element)

    def _end(self, _tag: str) -> None:
        self._open.pop()

    def _doctype(self, *_: object) -> NoReturn:
        what = "declares a document type (DOCTYPE); entities are not read"
        raise InputError(Problem(self.file, self.parser.CurrentLineNumber, 0, what, "remove the declaration"))
