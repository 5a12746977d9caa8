"""Values, declarations and modules as KRL text.

Numbers have up to six decimals, as compensation tables. A position is rounded by less than 1e-6 mm, and joints rounded
by 5e-7° move the TCP of a robot that reaches 3 m by less than 0.0001 mm. The controller's REAL has 24 bits: at 180° its
own rounding is 8e-6°, 0.0004 mm at 3 m.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping

DECIMALS = 6
LONGEST_NAME = 24
LONGEST_LINE = 470

_NAME = re.compile(rf"[A-Za-z_][A-Za-z0-9_$]{{0,{LONGEST_NAME - 1}}}")
_WHOLE = frozenset({"S", "T", "TOOL_NO", "BASE_NO"})
_HEADER = ("&ACCESS RVP", "&REL 1", "&PARAM EDITMASK = *")


def number_text(value: float) -> str:
    """A REAL: `-90.0`, `12.345678`, never with an exponent. Raises ValueError for one that is not finite."""
    if not math.isfinite(value):
        raise ValueError(f"{value} is no number of KRL")
    digits = f"{value:.{DECIMALS}f}".rstrip("0")
    digits += "0" * digits.endswith(".")
    return "0.0" if digits == "-0.0" else digits


def aggregate_text(values: Mapping[str, float]) -> str:
    """`{X 1.0,Y -2.5,S 2,T 35}`: components in the order of `values`; status, turn and numbers of frames are whole.

    Raises ValueError for a whole component with a fraction.
    """
    return "{" + ",".join(f"{label} {_value(label, value)}" for label, value in values.items()) + "}"


def _value(label: str, value: float) -> str:
    if label.upper() not in _WHOLE:
        return number_text(value)
    if not float(value).is_integer():
        raise ValueError(f"{label} {value} is not whole")
    return str(int(value))


def declaration_text(type_: str, name: str, values: Mapping[str, float] | None = None, *, rows: int = 0) -> str:
    """`DECL E6POS XP1={…}`, or the array `DECL E6AXIS P[30]` with `rows`. Raises ValueError for a name KRL refuses."""
    if not _NAME.fullmatch(name):
        raise ValueError(f"'{name}' is no name of KRL: letters, digits and _, at most {LONGEST_NAME}")
    size = f"[{rows}]" if rows else ""
    return f"DECL {type_} {name}{size}" + (f"={aggregate_text(values)}" if values is not None else "")


def data_list(name: str, lines: Iterable[str], comments: Iterable[str] = ()) -> str:
    """A data list (`.dat`) of module `name`, LF line ends. Raises ValueError for a line that a controller refuses."""
    return _module([f"DEFDAT {name}", *_comments(comments), *lines, "ENDDAT"])


def program(routines: Iterable[str], comments: Iterable[str] = ()) -> str:
    """A program (`.src`) of whole routines, the first with the module's name, LF line ends. Raises ValueError."""
    head, *rest = "\n".join(routines).split("\n")
    return _module([head, *_comments(comments), *rest])


def _comments(comments: Iterable[str]) -> list[str]:
    """Comment lines in ASCII: a character outside it becomes `?`, a line end a space; a long one is cut."""
    return [f"; {' '.join(text.split())}".encode("ascii", "replace").decode()[:LONGEST_LINE] for text in comments]


def _module(lines: Iterable[str]) -> str:
    written = [*_HEADER, *lines]
    for line in written:
        if len(line) > LONGEST_LINE or not line.isascii():
            raise ValueError(f"a controller may refuse this line: {line[:60]}…")
    return "\n".join(written) + "\n"
