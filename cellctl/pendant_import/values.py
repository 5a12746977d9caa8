"""Texts of a list as numbers: each row usable, or with the reason why not."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal

from cellctl.formats.spreadsheet_text import DecimalSign, decimal_sign, number
from cellctl.pendant_import.points import Point, PointList, Raw, RawList, Value

_FACTORS = {
    "mm": Decimal(1),
    "cm": Decimal(10),
    "m": Decimal(1000),
    "um": Decimal("0.001"),
    "inch": Decimal("25.4"),
}


def read_values(raw: RawList, numeric: Sequence[str], given: DecimalSign | None) -> PointList:
    """The list with its texts as numbers, in the units of the file. numeric: the columns that have to be numbers.

    Raises InputError where the decimal sign is ambiguous.
    """
    sign, how = _sign(raw, numeric, given)
    points = tuple(_point(point, numeric, sign) for point in raw.points)
    return PointList(raw.file, raw.source, points, (*raw.decided, *([how] if how else [])))


def in_mm(value: Value, unit: str) -> Value:
    """A length in mm, exactly as in its decimal digits."""
    return value if isinstance(value, str) else float(Decimal(repr(value)) * _FACTORS[unit])


def _sign(raw: RawList, numeric: Sequence[str], given: DecimalSign | None) -> tuple[DecimalSign, str]:
    if raw.source in ("krl", "rapid", "fanuc", "lists"):
        return "point", ""
    cells = ((point.line, point.texts.get(column, "")) for point in raw.points for column in numeric)
    return decimal_sign(raw.file, cells, given)


def _point(raw: Raw, numeric: Sequence[str], sign: DecimalSign) -> Point:
    values: dict[str, Value] = {}
    fault = raw.fault
    for column, text in raw.texts.items():
        read = number(text, sign)
        if read is not None:
            values[column] = float(read)
        elif column in numeric:
            fault = fault or (f"{column} '{text[:20]}' is not a number" if text else f"{column} is missing")
        elif text:
            values[column] = text
    missing = [column for column in numeric if column not in raw.texts]
    fault = fault or (f"{', '.join(missing)} missing" if missing else "")
    return Point(raw.line, raw.name, values, fault, raw.remark)
