"""Numbers in metrological notation: σ with two significant digits, the value with the same decimals."""

from __future__ import annotations

import math
from typing import Any

MINUS, DASH = "\N{MINUS SIGN}", "\N{EN DASH}"


def decimals(sigma: float, digits: int = 2) -> int:
    """Number of decimals that shows `sigma` with `digits` significant digits; at most 9."""
    if not math.isfinite(sigma) or sigma <= 0.0:
        return 3
    rounded = float(f"{sigma:.{digits - 1}e}")  # 0.0996 rounds to 0.10, with one decimal less
    return min(9, max(0, digits - 1 - math.floor(math.log10(rounded))))


def fixed(value: float | None, places: int = 3) -> str:
    """`value` with `places` decimals and a true minus sign; a dash for None, NaN and infinities."""
    if value is None or not math.isfinite(value):
        return DASH
    text = f"{value:.{places}f}"
    return text.lstrip("-") if float(text) == 0.0 else text.replace("-", MINUS)


def significant(value: float | None, digits: int = 2) -> str:
    """`value` with `digits` significant digits, never as a power of ten."""
    if value is None or not math.isfinite(value):
        return DASH
    return fixed(value, decimals(abs(value), digits)) if value else "0"


def with_sigma(value: float, sigma: float) -> str:
    """`−1.571 ± 0.037`; the value alone, to three decimals, unless σ is above 0."""
    if not math.isfinite(sigma) or sigma <= 0.0:
        return fixed(value)
    places = decimals(sigma)
    return f"{fixed(value, places)} ± {fixed(sigma, places)}"


def percent(share: float | None) -> str:
    """A share in whole per cent; `< 1 %` and `> 99 %` unless it is exactly 0 or 100."""
    if share is None or not math.isfinite(share):
        return DASH
    if 0.0 < share < 0.005:
        return "< 1 %"
    return "> 99 %" if 0.995 <= share < 1.0 else f"{100.0 * share:.0f} %"


def plain(value: Any) -> str:
    """Any journal value as text: floats to four significant digits at most, flags as yes and no, lists inline."""
    match value:
        case None:
            return DASH
        case bool():
            return "yes" if value else "no"
        case float():
            return _short(value)
        case dict():
            return ", ".join(f"{_spaced(key)} {plain(item)}" for key, item in value.items())
        case list() | tuple():
            return ", ".join(plain(item) for item in value)
        case _:
            return str(value)


def _short(value: float) -> str:
    text = significant(value, 4)
    return text.rstrip("0").rstrip(".") if "." in text else text


def _spaced(key: object) -> str:
    return str(key).replace("_", " ")
