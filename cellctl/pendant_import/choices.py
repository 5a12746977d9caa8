"""The user's choices where a file is ambiguous."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal, TypeAlias, final, get_args

from cellctl.files import InputError, Problem
from cellctl.formats.decimals import DecimalSign

Length: TypeAlias = Literal["mm", "cm", "m", "um", "inch"]
AngleUnit: TypeAlias = Literal["deg", "rad"]
Pair: TypeAlias = Literal["name", "order"]
Orientation: TypeAlias = Literal["abc", "quaternion"]

_ALLOWED = {"decimal": DecimalSign, "unit": Length, "angles": AngleUnit, "pair": Pair, "orientation": Orientation}


@final
@dataclass(frozen=True, slots=True)
class Choices:
    """The user's answers; None (or empty) leaves it to the files, which are refused where they are ambiguous.

    decimal: sign in tables. unit: of X, Y, Z. angles: of the joint readings. pair: how the two lists are paired.
    orientation: take A, B, C (KUKA: Rz Ry Rx, deg) or QW…QZ as well. columns: column of the data set → column of the
    file. repeats: several measurements of one point are several rows.
    """

    decimal: DecimalSign | None = None
    unit: Length | None = None
    angles: AngleUnit | None = None
    pair: Pair | None = None
    orientation: Orientation | None = None
    columns: Mapping[str, str] = field(default_factory=dict)
    repeats: bool = False


def choices(texts: Mapping[str, str | None], columns: Iterable[str] = (), *, repeats: bool = False) -> Choices:
    """The user's choices, checked. Raises InputError with every unknown one."""
    problems, given = [], {}
    for option, text in texts.items():
        allowed = get_args(_ALLOWED[option])
        if text is not None and text not in allowed:
            problems.append(Problem(f"--{option}", 0, 0, f"'{text}' is not known", " or ".join(allowed)))
        given[option] = text
    named: dict[str, str] = {}
    for item in ",".join(columns).split(","):
        target, equals, source = (part.strip() for part in item.partition("="))
        if item and not (target and equals and source):
            problems.append(Problem("--columns", 0, 0, f"'{item}' is not column=heading", "A1=shoulder,X=north"))
        elif item and target in named:
            problems.append(Problem("--columns", 0, 0, f"{target} is given twice", "give it once"))
        elif item:
            named[target] = source
    if problems:
        raise InputError(problems)
    return Choices(columns=named, repeats=repeats, **given)  # type: ignore[arg-type]  # checked above
