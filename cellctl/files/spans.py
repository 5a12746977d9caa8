"""Places in a file, and the same bytes with a few places changed: for files that a person goes on using."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

ENCODING = "latin-1"
"""One character for each byte, whatever the bytes are."""


class Span(NamedTuple):
    """A place in a file: characters `start` up to `end`, not included, counted from 0.

    A file is read as Latin-1: one character is one byte, so a span counts bytes.
    """

    start: int
    end: int


def replaced(data: bytes, values: Mapping[Span, str], name: str) -> bytes:
    """`data` with new text at these places; every other byte stays. An empty span inserts.

    Raises ValueError, naming the file, where two places overlap, one is outside of it, or a text is not Latin-1.
    """
    parts, at = [], 0
    for span, text in sorted(values.items()):
        if not at <= span.start <= span.end <= len(data):
            raise ValueError(f"{name}: places overlap or are outside the file, at byte {span.start}")
        parts += [data[at : span.start], text.encode(ENCODING)]
        at = span.end
    return b"".join([*parts, data[at:]])
