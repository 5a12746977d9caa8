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
    """An element: its name, attributes, children in order, and the line (from 1) and byte (from 0) of its first `<`."""

    tag: str
    attributes: dict[str, str]
    line: int
    start: int = 0
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
        what, cure = _words(error, builder.open_element)
        raise InputError(Problem(file, error.lineno, error.offset + 1, what, cure)) from error
    except (LookupError, ValueError) as error:  # an unknown encoding
        what = "is not XML: its first line names an encoding that is not known"
        raise InputError(Problem(file, 1, 0, what, "save the file as UTF-8")) from error
    return builder.root.children[0]


_WORDS = {
    expat.errors.XML_ERROR_INVALID_TOKEN: (
        "a character that cannot stand here",
        "in text write &amp; for & and &lt; for <",
    ),
    expat.errors.XML_ERROR_UNCLOSED_TOKEN: ("a tag is not closed", "end it with >, and close its quotes"),
    expat.errors.XML_ERROR_DUPLICATE_ATTRIBUTE: ("an attribute stands twice in one tag", "remove one of them"),
    expat.errors.XML_ERROR_JUNK_AFTER_DOC_ELEMENT: ("something follows the end of the document", "remove it"),
    expat.errors.XML_ERROR_UNDEFINED_ENTITY: ("an entity (&…;) that is not defined", "write the character itself"),
    expat.errors.XML_ERROR_MISPLACED_XML_PI: (
        "<?xml …?> is not at the beginning of the file",
        "remove what is before it",
    ),
}
"""By the name of expat's error: what is wrong, and the cure."""


def _words(error: expat.ExpatError, unclosed: Element | None) -> tuple[str, str]:
    """What is wrong, and the cure; `unclosed`: the innermost element that is open at the error."""
    kind = expat.errors.messages[error.code]
    if unclosed and kind in (expat.errors.XML_ERROR_TAG_MISMATCH, expat.errors.XML_ERROR_NO_ELEMENTS):
        what = f"<{unclosed.tag}> of line {unclosed.line} is not closed before this place"
        return f"is not XML here: {what}", f"add </{unclosed.tag}>, or mend the closing tag"
    what, cure = _WORDS.get(kind, ("there is no element that could be read", "check the tags and quotes"))
    return f"is not XML here: {what}", cure


class _Builder:
    def __init__(self, file: str) -> None:
        self.file = file
        self.root = Element("", {}, 0)
        self._open = [self.root]
        self.parser = expat.ParserCreate()
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.StartDoctypeDeclHandler = self._doctype

    @property
    def open_element(self) -> Element | None:
        """The innermost element that is not closed yet."""
        return self._open[-1] if len(self._open) > 1 else None

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        element = Element(tag, attributes, self.parser.CurrentLineNumber, self.parser.CurrentByteIndex)
        self._open[-1].children.append(element)
        self._open.append(element)

    def _end(self, _tag: str) -> None:
        self._open.pop()

    def _doctype(self, *_: object) -> NoReturn:
        what = "declares a document type (DOCTYPE); entities are not read"
        raise InputError(Problem(self.file, self.parser.CurrentLineNumber, 0, what, "remove the declaration"))
