"""Fields of a command's XML: numbers, whole numbers and texts, each missed with a reason."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from typing import final

from sims.krc.decimals import decimal
from sims.scene.motions import Joints

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
