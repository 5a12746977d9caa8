"""Numbers as people write them: `1234.5`, `1234,5`, `1.234,5`, `1'234.5`, `1 234,5`; `1,234` alone is ambiguous."""

from __future__ import annotations

import re
from collections.abc import Iterable
from decimal import Decimal
from typing import Literal, TypeAlias

from cellctl.files import InputError, Problem

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
