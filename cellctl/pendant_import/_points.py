"""Points of a list in the order of the file, each usable or with the reason why not: from text to numbers."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path
from typing import TypeAlias, final

from cellctl.files import InputError, Problem
from cellctl.files.kinds import EXPORT, OWN, kind_of, read_bytes, refuse_other_kind
from cellctl.formats.spreadsheet_text import DecimalSign, decimal_sign, decoded, number


def read_text(path: Path) -> str:
    """The file's text: UTF-8 or UTF-16 (marked), else Windows' Western code page. Raises InputError."""
    text = decoded(read_bytes(path), str(path))
    if (found := kind_of(text)) in OWN:
        refuse_other_kind(path, EXPORT, found)
    if "\0" in text:
        raise InputError(Problem(str(path), 0, 0, "is not text", "give a KRL, script or CSV file"))
    if not text.strip():
        raise InputError(Problem(str(path), 0, 0, "is empty"))
    return text


def lines_of(text: str) -> list[str]:
    """The lines, with any line ends; unlike in `str.splitlines`, only CR and LF end a line."""
    return re.split(r"\r\n|\n|\r", text)


def unified(text: str) -> str:
    """The text with LF at the end of each line."""
    return text.replace("\r\n", "\n").replace("\r", "\n")


@final
@dataclass(frozen=True, slots=True)
class Source:
    """The kind of text of a list, and what it defines. decimal_point: its numbers have one. x_before_names: its points
    have an X before their names (`XP1` is P1). j3_from_horizontal: J3 counts from the horizontal.
    """

    name: str
    decimal_point: bool = False
    x_before_names: bool = False
    j3_from_horizontal: bool = False


TABLE = Source("table")

Value: TypeAlias = float | str
"""A cell: a number, or text in a column that is not numeric."""


@final
@dataclass(frozen=True, slots=True)
class Point:
    """One point of a list. name: as it is written, empty where there is none. values: by column of a data set.

    fault: why it cannot be used, empty where it can. A point with a fault keeps its place: pairing by order counts it.
    """

    line: int
    name: str
    values: Mapping[str, Value]
    fault: str = ""
    remark: str = ""


@final
@dataclass(frozen=True, slots=True)
class PointList:
    """A file's points, and the decisions made in reading it, in words for the user."""

    file: str
    source: Source
    points: tuple[Point, ...]
    decided: tuple[str, ...] = ()

    @property
    def named(self) -> bool:
        """Whether points have names; some may be missing."""
        return any(point.name for point in self.points)


@final
@dataclass(frozen=True, slots=True)
class Raw:
    """A point before its numbers are read: the text of each value, by column."""

    line: int
    name: str
    texts: Mapping[str, str]
    fault: str = ""
    remark: str = ""


@final
@dataclass(frozen=True, slots=True)
class RawList:
    """Points as text. units: the unit that the file states for a column (`mm`, `deg`, …), where it does; stated_by: the
    place that states it.
    """

    file: str
    source: Source
    points: tuple[Raw, ...]
    units: Mapping[str, str] = field(default_factory=dict)
    decided: tuple[str, ...] = ()
    heading_line: int = 0
    stated_by: str = "the headings say"


@final
@dataclass(frozen=True, slots=True)
class Taught:
    """A point of a program before its numbers are read: joints (`A1…`, `J1…`, `q1…`) or a Cartesian pose, as text.

    pose: X, Y, Z, the angles of the format, and its `frame`, where the program names it. kind: the type in the
    program. fault: why it is neither. remark: its comment.
    """

    line: int
    name: str
    kind: str
    joints: Mapping[str, str] = field(default_factory=dict)
    pose: Mapping[str, str] = field(default_factory=dict)
    fault: str = ""
    remark: str = ""

    def posture(self) -> Raw:
        """The point of a joint list; a Cartesian one has a fault."""
        what = f"{self.kind} is Cartesian: joint readings are needed" if self.pose else ""
        return Raw(self.line, self.name, self.joints, self.fault or what, self.remark)

    def target(self) -> Raw:
        """The point of a target list; one of joints has a fault."""
        what = f"{self.kind} holds joints: a target is Cartesian" if self.joints else ""
        return Raw(self.line, self.name, self.pose, self.fault or what, self.remark)


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
    if raw.source.decimal_point:
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
