"""The PC's answer: `<Sen Type="…">`, a value for each RECEIVE tag, the IPOC of the telegram it answers."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

from sims.krc.decimals import count, decimal
from sims.krc.ethernet_config import Element
from sims.krc.xml_documents import parse

LARGEST_IPOC = 10**15
LARGEST_VALUE = 3600.0
"""Of a correction, degrees: ten turns."""

_TRUTH = {"TRUE": 1.0, "FALSE": 0.0, "true": 1.0, "false": 0.0}


@final
@dataclass(frozen=True, slots=True)
class Reply:
    """An answer that could be read. `values`: tag → number, only of tags that it gave."""

    sentype: str
    ipoc: int
    values: dict[str, float]


def read_reply(data: bytes, wired: Sequence[Element]) -> Reply | None:
    """Read an answer by name, of the RECEIVE tags those `wired`; None where it is not an answer.

    That is: not XML, more than 8 KiB, no IPOC, or a wired tag whose value is no number of a possible size.
    """
    try:
        root = parse(data)
        if root.tag != "Sen":
            return None
        ipoc = count(root.findtext("IPOC", ""), LARGEST_IPOC)
        return Reply(root.get("Type", ""), ipoc, _values(root, wired))
    except ValueError:
        return None


def _values(root: ET.Element, wired: Sequence[Element]) -> dict[str, float]:
    children = {child.tag: child for child in root}
    values = {}
    for element in wired:
        child = children.get(element.name)
        if child is None:
            continue
        text = child.get(element.attribute) if element.attribute else child.text
        if text is not None:
            values[element.tag] = _number(text)
    return values


def _number(text: str) -> float:
    return _TRUTH[text] if text in _TRUTH else decimal(text, LARGEST_VALUE)
