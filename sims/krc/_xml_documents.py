"""XML from the PC: documents of a bounded size, and their fields and decimals, refused with a reason."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from typing import final

from sims.scene.motions import Joints

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


_DECIMAL = re.compile(r"[+-]?[0-9]+(\.[0-9]+)?([eE][+-]?[0-9]+)?")
_DIGITS = re.compile(r"[0-9]{1,16}")


def decimal(text: str, largest: float) -> float:
    """A number with digits before and after its point, where it has one; at most `largest` in size.

    Raises ValueError: no such number (`1_0`, `٣`, `nan`, white space), or larger.
    """
    if not _DECIMAL.fullmatch(text):
        raise ValueError(f"is no number: '{text[:40]}'")
    value = float(text)
    if not abs(value) <= largest:
        raise ValueError(f"is outside ±{largest:g}: {text[:40]}")
    return value


def count(text: str, largest: int) -> int:
    """A whole number of digits alone, 0 … `largest`. Raises ValueError."""
    if not _DIGITS.fullmatch(text) or int(text) > largest:
        raise ValueError(f"is no whole number of 0 … {largest}: '{text[:40]}'")
    return int(text)


_LARGEST_ANGLE_DEG = 3600.0

_WHOLE = re.compile(r"-?[0-9]{1,9}")


@final
class Unreadable(ValueError):
    """No command; `id` is its Id where that much could be read."""

    def __init__(self, what: str, command_id: str = "") -> None:
        self.id = command_id
        super().__init__(what)


def child(parent: ET.Element, name: str) -> ET.Element:
    """The first child of that name. Raises Unreadable."""
    found = parent.find(name)
    if found is None:
        raise Unreadable(f"{parent.tag} has no {name}")
    return found


def number(element: ET.Element, attribute: str, largest: float) -> float:
    """A number of at most `largest` in size. Raises Unreadable."""
    try:
        return decimal(element.get(attribute, ""), largest)
    except ValueError as error:
        raise Unreadable(f"{element.tag} {attribute} {error}") from None


def whole(element: ET.Element, attribute: str) -> int:
    """A whole number of at most nine digits. Raises Unreadable."""
    value = element.get(attribute, "")
    if not _WHOLE.fullmatch(value):
        raise Unreadable(f"{element.tag} {attribute} is no whole number: '{value}'")
    return int(value)


def word(element: ET.Element, attribute: str) -> str:
    """A text that is not empty. Raises Unreadable."""
    value = element.get(attribute, "")
    if not value:
        raise Unreadable(f"{element.tag} has no {attribute}")
    return value


def joints(element: ET.Element, axes: int) -> Joints:
    """A1…An, degrees, each at most ten turns. Raises Unreadable."""
    return tuple(number(element, f"A{axis}", _LARGEST_ANGLE_DEG) for axis in range(1, axes + 1))
