"""Types of KRL and their values as text: INT, BOOL, CHAR arrays, structures of these."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol, final

LARGEST = 2**31 - 1

_PART = re.compile(r'(\w+)(\[\])?\s+("[^"]*"|[^,"]+)')


class BadValue(ValueError):
    """A text that is no value of the type."""


class Kind(Protocol):
    """A type: a variable's first value, its text, and what a text makes of the value before it."""

    def first(self) -> Any:
        """The value before anything was written."""

    def shown(self, value: Any) -> str:
        """The value as the controller prints it."""

    def read(self, text: str, before: Any) -> Any:
        """The value that `text` says. Raises BadValue."""


@final
class Int:
    """A whole number of 32 bits."""

    def first(self) -> int:
        """Zero."""
        return 0

    def shown(self, value: int) -> str:
        """Decimal."""
        return str(value)

    def read(self, text: str, before: int) -> int:
        """A real number is rounded, as an assignment in KRL does."""
        if not re.fullmatch(r"\s*[-+]?\d+(\.\d*)?\s*", text, re.ASCII):
            raise BadValue(text)
        value = round(float(text)) if "." in text else int(text)
        if not -LARGEST - 1 <= value <= LARGEST:
            raise BadValue(text)
        return value


@final
class Bool:
    """TRUE or FALSE."""

    def first(self) -> bool:
        """FALSE."""
        return False

    def shown(self, value: bool) -> str:
        """In capital letters."""
        return "TRUE" if value else "FALSE"

    def read(self, text: str, before: bool) -> bool:
        """In any letters."""
        word = text.strip().upper()
        if word not in ("TRUE", "FALSE"):
            raise BadValue(text)
        return word == "TRUE"


@final
@dataclass(frozen=True)
class Chars:
    """A CHAR array of `size`."""

    size: int

    def first(self) -> str:
        """A blank, as the data list has it."""
        return " "

    def shown(self, value: str) -> str:
        """In quotation marks."""
        return f'"{value}"'

    def read(self, text: str, before: str) -> str:
        """With or without quotation marks; what is too long is refused."""
        value = text.strip().strip('"')
        if len(value) > self.size:
            raise BadValue(text)
        return value


@final
@dataclass(frozen=True)
class Structure:
    """A STRUC: its name and its fields. A field that a text leaves out stays as it was."""

    name: str
    fields: Mapping[str, Kind]

    def first(self) -> dict[str, Any]:
        """Each field's first value."""
        return {name: kind.first() for name, kind in self.fields.items()}

    def shown(self, value: Mapping[str, Any]) -> str:
        """`{NAME: A 1, B[] "x"}`."""
        parts = []
        for name, kind in self.fields.items():
            mark = "[]" if isinstance(kind, Chars) else ""
            parts.append(f"{name}{mark} {kind.shown(value[name])}")
        return "{" + f"{self.name}: " + ", ".join(parts) + "}"

    def read(self, text: str, before: Mapping[str, Any]) -> dict[str, Any]:
        """Any order, with or without the name before the colon."""
        found = re.fullmatch(r"\s*\{\s*(?:(\w+)\s*:)?\s*(.*?)\s*\}\s*", text, re.DOTALL)
        if not found or (found[1] and found[1].upper() != self.name):
            raise BadValue(text)
        value, rest = dict(before), found[2]
        while rest:
            part = _PART.match(rest)
            kind = self.fields.get(part[1].upper()) if part else None
            if part is None or kind is None or bool(part[2]) != isinstance(kind, Chars):
                raise BadValue(text)
            value[part[1].upper()] = kind.read(part[3], value[part[1].upper()])
            rest = rest[part.end() :].lstrip(" ,")
        return value
