"""The measuring conditions of a data set, from its columns: instrument, operator, date, temperature."""

from __future__ import annotations

import math

from cellctl.formats import DataSet
from cellctl.report.numbers import fixed

NOT_RECORDED = "not recorded"

_MOST = 3
"""Maximum number of different values listed of a column."""


def conditions_of(data: DataSet) -> list[tuple[str, str]]:
    """Name and text of each condition; `not recorded` if the data set has no such column."""
    named = [(name, _named(data, name)) for name in ("instrument", "serial", "operator", "date")]
    return [*named, ("temperature", temperature(data))]


def temperature(data: DataSet | None) -> str:
    """`21.0 … 23.5 °C`, from the column `temperature`."""
    found = [value for text in (data.texts("temperature") if data else []) if math.isfinite(value := _number(text))]
    if not found:
        return NOT_RECORDED
    low, high = fixed(min(found), 1), fixed(max(found), 1)
    return f"{low} °C" if low == high else f"{low} … {high} °C"


def _named(data: DataSet, column: str) -> str:
    values = list(dict.fromkeys(text for text in data.texts(column) if text))
    more = f", {len(values) - _MOST} more" if len(values) > _MOST else ""
    return ", ".join(values[:_MOST]) + more if values else NOT_RECORDED


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan
