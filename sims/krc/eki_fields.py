"""Fields of a command's XML: numbers, whole numbers and texts, each missed with a reason."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from math import isfinite
from typing import final

from sims.krc.motions import Joints

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


def number(element: ET.Element, attribute: str) -> float:
    """A finite number. Raises Unreadable."""
    text = element.get(attribute, "")
    try:
        value = float(text)
    except ValueError:
        raise Unreadable(f"{element.tag} {attribute} is no number: '{text}'") from None
    if not isfinite(value):
        raise Unreadable(f"{element.tag} {attribute} is not finite")
    return value


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
    """A1…An, degrees. Raises Unreadable."""
    return tuple(number(element, f"A{axis}") for axis in range(1, axes + 1))
