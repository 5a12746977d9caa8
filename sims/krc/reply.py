"""The PC's answer: `<Sen Type="…">`, a value for each RECEIVE tag, the IPOC of the telegram it answers."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from typing import final

from sims.krc.ethernet_config import Element


@final
@dataclass(frozen=True, slots=True)
class Reply:
    """An answer that could be read. `values`: tag → number, only of tags that it gave."""

    sentype: str
    ipoc: int
    values: dict[str, float]


def read_reply(data: bytes, receive: Sequence[Element]) -> Reply | None:
    """Read an answer by name; None where it is not one (no XML, no IPOC, a value that is no finite number)."""
    try:
        root = ET.fromstring(data)
        if root.tag != "Sen":
            return None
        ipoc = int(root.findtext("IPOC", ""))
        return Reply(root.get("Type", ""), ipoc, _values(root, receive))
    except (ET.ParseError, ValueError, LookupError):  # LookupError: an encoding that there is not
        return None


def _values(root: ET.Element, receive: Sequence[Element]) -> dict[str, float]:
    children = {child.tag: child for child in root}
    values = {}
    for element in receive:
        child = children.get(element.name)
        if child is None or element.type == "STRING":
            continue
        text = child.get(element.attribute) if element.attribute else child.text
        if text is not None:
            values[element.tag] = _number(text)
    return values


def _number(text: str) -> float:
    value = {"TRUE": 1.0, "FALSE": 0.0}.get(text.strip().upper())
    if value is None:
        value = float(text)
    if not isfinite(value):
        raise ValueError(f"{text} is not finite")
    return value
