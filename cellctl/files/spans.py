"""Places in a file, and the same bytes with a few places changed: for files that a person goes on using."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple, Self

ENCODING = "latin-1"
"""One character for each byte, whatever the bytes are."""


class Span(NamedTuple):
    """A place in a file: characters `start` up to `end`, not included, counted from 0.

    A file is read as Latin-1: one character is one byte, so a span counts bytes.
    """

    start: int
    end: int


@dataclass(frozen=True)
class FileInPlace:
    """name: for messages. data: the bytes, unchanged; spans count them."""

    name: str
    data: bytes

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a file. Raises OSError."""
        return cls(str(path), path.read_bytes())

    @cached_property
    def text(self) -> str:
        """The bytes as Latin-1: one character for each."""
        return self.data.decode(ENCODING)

    def source(self, span: Span) -> str:
        """The text at a place."""
        return self.text[span.start : span.end]

    def replaced(self, values: Mapping[Span, str]) -> bytes:
        """The file with new text at these places; every other byte stays. An empty span inserts.

        Raises ValueError where two places overlap, one is outside the file, or a text is not Latin-1.
        """
        parts, at = [], 0
        for span, text in sorted(values.items()):
            if not at <= span.start <= span.end <= len(self.data):
                raise ValueError(f"{self.name}: places overlap or are outside the file, at byte {span.start}")
            parts += [self.data[at : span.start], text.encode(ENCODING)]
            at = span.end
        return b"".join([*parts, self.data[at:]])
