"""Documents from the PC: XML of a bounded size, without a document type, so that no entity can grow."""

from __future__ import annotations

import xml.etree.ElementTree as ET

LARGEST = 8192
"""Bytes. A block of ten table rows, the largest document of either channel, has under 4 KiB."""


def parse(document: bytes) -> ET.Element:
    """The root element. Raises ValueError where the document is too large, has a document type, or is not XML."""
    if len(document) > LARGEST:
        raise ValueError(f"a document of more than {LARGEST} bytes")
    if b"<!DOCTYPE" in document or b"\0" in document:  # NUL: UTF-16, in which a document type is written otherwise
        raise ValueError("not XML as this controller reads it: a document type, or an encoding of two bytes")
    try:
        return ET.fromstring(document)
    except (ET.ParseError, LookupError) as error:  # LookupError: an encoding that there is not
        raise ValueError(f"not XML: {error}") from None
