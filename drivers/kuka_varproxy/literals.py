"""KRL values as the proxy writes them: whole numbers, truth values, texts, enumerations, structures."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

from cellctl.devices import JointReadings

AXES = 6

_FIELD = re.compile(r'\s*(\w+(?:\[\])?)\s+("[^"]*"|[^\s,]+)\s*(?:,|$)')


def whole(text: str) -> int:
    """`"17"` → 17. Raises ValueError."""
    if not re.fullmatch(r"\s*[-+]?\d{1,10}\s*", text, re.ASCII):
        raise ValueError(f"'{text}' is no whole number")
    return int(text)


def number(text: str) -> float:
    """`"-185.0"` → -185.0. Raises ValueError."""
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"'{text}' is no number")
    return value


def truth(text: str) -> bool:
    """`"TRUE"` → True. Raises ValueError."""
    known = {"TRUE": True, "FALSE": False}
    if text.strip().upper() not in known:
        raise ValueError(f"'{text}' is neither TRUE nor FALSE")
    return known[text.strip().upper()]


def plain_text(text: str) -> str:
    """`'"KR5"'` → `KR5`: a text without its quotation marks; a number or an enumeration as it is."""
    return text.strip().strip('"').strip("\0 ")


def fields(text: str) -> dict[str, str]:
    """`"{AXIS: A1 0.0, A2 -90.0}"` → `{"A1": "0.0", "A2": "-90.0"}`; texts keep their marks. Raises ValueError."""
    found = re.fullmatch(r"\s*\{\s*(?:\w+\s*:)?(.*)\}\s*", text, re.DOTALL)
    if not found:
        raise ValueError(f"'{text[:60]}' is no structure")
    rest, at, values = found[1], 0, {}
    while rest[at:].strip():
        field = _FIELD.match(rest, at)
        if not field:
            raise ValueError(f"'{rest[at:][:40]}' is no field of a structure")
        values[field[1].upper()] = field[2]
        at = field.end()
    return values


def structure(kind: str, values: Mapping[str, int | str]) -> str:
    """`{KIND: A1 5, ID[] "abc"}`. Raises ValueError for a text with a quotation mark."""
    return "{" + f"{kind}: " + ", ".join(f"{name} {_written(value)}" for name, value in values.items()) + "}"


def same(written: str, read: str) -> bool:
    """Whether the value read back is the one written, however the controller prints spaces, case and field order."""
    if written.startswith("{"):
        return {name: plain_text(value) for name, value in fields(written).items()} == {
            name: plain_text(value) for name, value in fields(read).items()
        }
    return plain_text(written) == plain_text(read)


def joints(text: str) -> JointReadings:
    """A1 … A6 of an AXIS or E6AXIS, degrees. Raises ValueError."""
    values = fields(text)
    try:
        return tuple(number(values[f"A{axis}"]) for axis in range(1, AXES + 1))
    except KeyError as missing:
        raise ValueError(f"'{text[:60]}' lacks {missing.args[0]}") from None


def _written(value: int | str) -> str:
    if isinstance(value, int):
        return str(value)
    if '"' in value:
        raise ValueError(f"'{value}' has a quotation mark")
    return f'"{value}"'
