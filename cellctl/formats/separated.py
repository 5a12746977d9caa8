"""Tables as saved by spreadsheets: column separators, decimal commas, empty columns on the right."""

from __future__ import annotations

import re
from collections.abc import Sequence

from cellctl.files import InputError, Problem
from cellctl.formats.decimals import Cell, DecimalSign, decimal_sign, number

_SEPARATORS = (",", ";", "\t")
_SAID = re.compile(r'"?sep=(.)"?\s*', re.IGNORECASE)
_NUMBERS = re.compile(
    r"[AqDI]\d+|[XYZABC]|Q[WXYZ]|s[XYZRD]|radius|tip_radius|drift|distance|temperature|payload(_[xyz])?|time"
    r"|theta|alpha|beta|[da]|offset|min|max|max_speed",  # of a table of links
)
"""Columns that hold numbers; a name (`S1`, `1,5`) stays as it is written."""


def separator(text: str) -> tuple[str, bool]:
    """The column separator of `text`, and whether the first line only states it (Excel's `sep=;`)."""
    first = re.split(r"[\r\n]", text, maxsplit=1)[0]
    said = _SAID.fullmatch(first)
    return (said[1], True) if said else (max(_SEPARATORS, key=first.count), False)


def named(header: Sequence[str]) -> int:
    """Number of columns up to the last one with a name."""
    return max((place for place, name in enumerate(header, 1) if name), default=0)


def with_points(
    header: Sequence[str], cells: list[tuple[str, ...]], lines: Sequence[int], file: str
) -> list[tuple[str, ...]]:
    """`cells` with decimal points where they have decimal commas, and without signs between thousands.

    Where the rows contradict each other, or are ambiguous (`1,234`), InputError names the lines.
    """
    places = [place for place, name in enumerate(header) if _NUMBERS.fullmatch(name)]
    if not any("," in row[place] for row in cells for place in places):
        return cells
    sign = _sign(file, [(line, row[place]) for line, row in zip(lines, cells, strict=True) for place in places])
    numeric = set(places)
    return [tuple(_pointed(text, sign) if at in numeric else text for at, text in enumerate(row)) for row in cells]


def _sign(file: str, cells: Sequence[Cell]) -> DecimalSign:
    try:
        return decimal_sign(file, cells, None)[0]
    except InputError as error:
        cure = "write all numbers with a decimal point, and without signs between thousands"
        raise InputError(Problem(file, each.line, 0, each.what, cure) for each in error.problems) from error


def _pointed(text: str, sign: DecimalSign) -> str:
    value = number(text, sign)
    return text if value is None else str(value)
