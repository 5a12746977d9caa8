"""Numbers on the controller's wires: ASCII decimals of a bounded size; Python's other formats are refused."""

from __future__ import annotations

import re

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
