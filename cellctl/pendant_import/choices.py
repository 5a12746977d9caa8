"""The user's choices where a file is ambiguous."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal, TypeAlias, final, get_args

from cellctl.files import InputError, Problem
from cellctl.formats.spreadsheet_text import DecimalSign

Length: TypeAlias = Literal["mm", "cm", "m", "um", "inch"]
AngleUnit: TypeAlias = Literal["deg", "rad"]
Pair: TypeAlias = Literal["name", "order"]
Orientation: TypeAlias = Literal["abc", "quaternion", "fixed-xyz", "euler-xyz", "rotation-vector"]
ThirdJoint: TypeAlias = Literal["horizontal", "arm"]

_ALLOWED = {
    "decimal": DecimalSign,
    "unit": Length,
    "angles": AngleUnit,
    "pair": Pair,
    "orientation": Orientation,
    "j3": ThirdJoint,
}
_MOST_SIGMAS = 10.0
_BETWEEN = re.compile(r",(?=[^,=]*=)")
"""A comma between two columns; one inside a heading (`X, mm`) has no `=` before the next."""


@final
@dataclass(frozen=True, slots=True)
class Choices:
    """The user's answers; None (or empty) leaves it to the files, which are refused where they are ambiguous.

    decimal: sign in tables. unit: of X, Y, Z. angles: of the joint readings. pair: how the two lists are paired.
    orientation: take A, B, C (KUKA: Rz Ry Rx, deg), QW…QZ or RX, RY, RZ as well. columns: column of the data set →
    column of the file. repeats: several measurements of one point are several rows. j3: the third joint's reading
    counts from the horizontal (FANUC), or is the angle between the arms. coverage: how many σ a stated uncertainty is.
    group, frame: take only the points of this group, or in this frame.
    """

    decimal: DecimalSign | None = None
    unit: Length | None = None
    angles: AngleUnit | None = None
    pair: Pair | None = None
    orientation: Orientation | None = None
    columns: Mapping[str, str] = field(default_factory=dict)
    repeats: bool = False
    j3: ThirdJoint | None = None
    coverage: float | None = None
    group: str | None = None
    frame: str | None = None


def choices(
    texts: Mapping[str, str | None],
    columns: Iterable[str] = (),
    *,
    repeats: bool = False,
    coverage: float | None = None,
    group: str | None = None,
    frame: str | None = None,
) -> Choices:
    """The user's choices, checked. Raises InputError with every unknown one."""
    problems, given = [], {}
    if coverage is not None and not 0.0 < coverage <= _MOST_SIGMAS:
        problems.append(Problem("--coverage", 0, 0, f"{coverage:g} is no number of σ", "1, 2 or 3, as the file has it"))
    for option, text in texts.items():
        allowed = get_args(_ALLOWED[option])
        if text is not None and text not in allowed:
            problems.append(Problem(f"--{option}", 0, 0, f"'{text}' is not known", " or ".join(allowed)))
        given[option] = text
    named: dict[str, str] = {}
    for item in _BETWEEN.split(",".join(columns)):
        target, equals, source = (part.strip() for part in item.partition("="))
        if item and not (target and equals and source):
            problems.append(Problem("--columns", 0, 0, f"'{item}' is not column=heading", "A1=shoulder,X=north"))
        elif item and target in named:
            problems.append(Problem("--columns", 0, 0, f"{target} is given twice", "give it once"))
        elif item:
            named[target] = source
    if problems:
        raise InputError(problems)
    free = {"coverage": coverage, "group": group, "frame": frame}
    return Choices(columns=named, repeats=repeats, **free, **given)  # type: ignore[arg-type]  # checked above
