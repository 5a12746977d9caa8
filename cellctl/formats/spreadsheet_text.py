"""Text as people and spreadsheets save it: encodings, column separators, and numbers with their decimal sign."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from decimal import Decimal
from typing import Literal, TypeAlias

from cellctl.files import InputError, Problem
from cellctl.formats.workbook import START, table_of_workbook

_SPREADSHEETS = {
    b"\xd0\xcf\x11\xe0": "a spreadsheet (xls)",
}


def decoded(data: bytes, file: str) -> str:
    """A file's text: UTF-8 or UTF-16 (marked), else Windows' Western code page; of a workbook (`.xlsx`) its sheet's.

    `file` names it in errors. Raises InputError for another spreadsheet.
    """
    for start, what in _SPREADSHEETS.items():
        if data.startswith(start):
            raise InputError(Problem(file, 0, 0, f"is {what}, not text", "save the sheet as CSV"))
    if data.startswith(START):
        return table_of_workbook(data, file)
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return data.decode("utf-16", "replace")
    for encoding in ("utf-8-sig", "cp1252"):
        try:
            return data.decode(encoding)
        except UnicodeDecodeError:
            continue
    return data.decode("latin-1")


DecimalSign: TypeAlias = Literal["comma", "point"]

Cell: TypeAlias = tuple[int, str]
"""A cell's line in its file, and its text."""

_MINUS = str.maketrans({"−": "-", "–": "-"})
_SPACES = " \u00a0\u2009\u202f"


def _grammar(decimal: str, group: str) -> re.Pattern[str]:
    """The two ways to write a number: groups of three digits, or plain digits with or without a power of ten."""
    plain = rf"[0-9]+(?:{decimal}[0-9]+)?|{decimal}[0-9]+"
    grouped = (
        rf"[1-9][0-9]{{0,2}}(?P<group>[{group}'’{_SPACES}])[0-9]{{3}}(?:(?P=group)[0-9]{{3}})*(?:{decimal}[0-9]+)?"
    )
    return re.compile(rf"(?P<sign>[-+]?)(?:(?P<grouped>{grouped})|(?P<plain>{plain})(?P<power>[eE][-+]?[0-9]{{1,3}})?)")


_GRAMMARS: dict[DecimalSign, re.Pattern[str]] = {"point": _grammar(r"\.", ","), "comma": _grammar(",", r"\.")}


def number(text: str, sign: DecimalSign) -> Decimal | None:
    """The exact number of `text` with this decimal sign; None where it is not a number. Thousands may be grouped."""
    found = _GRAMMARS[sign].fullmatch(text.translate(_MINUS))
    if found is None:
        return None
    digits = found["plain"] or re.sub(rf"[{re.escape(found['group'])}]", "", found["grouped"])
    return Decimal(found["sign"] + digits.replace(",", ".") + (found["power"] or ""))


def is_number(text: str, *, spaced: bool = True) -> bool:
    """Whether `text` is a number with one decimal sign or the other. spaced: spaces may group its thousands."""
    refused = not spaced and any(space in text for space in _SPACES)
    return not refused and any(number(text, sign) is not None for sign in _GRAMMARS)


def decimal_sign(file: str, cells: Iterable[Cell], given: DecimalSign | None) -> tuple[DecimalSign, str]:
    """The decimal sign of a table and, in words, the reason (empty where no number needs one).

    Numbers that can be read in only one way decide. Where they contradict each other, or all with a sign are ambiguous
    (`1,234`), `given` decides; without it InputError names the lines and the cure.
    """
    clear: dict[DecimalSign, Cell] = {}
    open_: dict[DecimalSign, Cell] = {}
    grouped = False
    for line, text in cells:
        readings = {sign: value for sign in _GRAMMARS if (value := number(text, sign)) is not None}
        if len(readings) == 1:
            clear.setdefault(next(iter(readings)), (line, text))
            grouped = grouped or sum(text.count(mark) for mark in ",.") > 1
        elif len(set(readings.values())) == 2:
            open_.setdefault("point" if "." in text else "comma", (line, text))
    if len(clear) == 1 and (grouped or clear.keys() >= open_.keys()):
        sign, (line, text) = next(iter(clear.items()))
        overruled = f", whatever --decimal {given} says" if given not in (None, sign) else ""
        return sign, f"decimal {sign}, as '{text}' on line {line} says{overruled}"
    if not clear and not open_:
        return given or "point", ""
    if given is not None:
        return given, f"decimal {given}, as --decimal says"
    raise InputError(_contradiction(file, clear) if len(clear) == 2 else _two_readings(file, clear, open_))


def _contradiction(file: str, clear: dict[DecimalSign, Cell]) -> Problem:
    (line, comma), (other, point) = clear["comma"], clear["point"]
    what = f"'{comma}' has a decimal comma, '{point}' on line {other} a decimal point"
    return Problem(file, line, 0, what, "correct one of them, or say --decimal comma or --decimal point")


def _two_readings(file: str, clear: dict[DecimalSign, Cell], open_: dict[DecimalSign, Cell]) -> Problem:
    line, text = next(cell for sign, cell in open_.items() if sign not in clear)
    as_point, as_comma = (f"{number(text, sign):f}" for sign in ("point", "comma"))
    beside = "".join(f", beside '{other}' on line {at}" for at, other in clear.values())
    what = f"'{text}'{beside} may be {as_point} or {as_comma}"
    return Problem(file, line, 0, what, f"--decimal point reads it as {as_point}, --decimal comma as {as_comma}")


_SEPARATORS = (",", ";", "\t")
_STATED = re.compile(r'"?sep=(.)"?\s*', re.IGNORECASE)
_NUMBERS = re.compile(
    r"[AqDI]\d+|[XYZABC]|Q[WXYZ]|s[XYZRD]|radius|tip_radius|drift|distance|temperature|payload(_[xyz])?|time"
    r"|theta|alpha|beta|[da]|offset|min|max|max_speed",  # of a table of links
)
"""Columns that hold numbers; a name (`S1`, `1,5`) stays as it is written."""


def stated_separator(line: str) -> str | None:
    """The column separator that a line states and holds nothing else (Excel's `sep=;`); None for any other line."""
    stated = _STATED.fullmatch(line)
    return stated[1] if stated else None


def separator(text: str) -> tuple[str, bool]:
    """The column separator of `text`, and whether the first line only states it."""
    first = re.split(r"[\r\n]", text, maxsplit=1)[0]
    stated = stated_separator(first)
    return (stated, True) if stated else (max(_SEPARATORS, key=first.count), False)


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
