"""Points of a list in the order of the file, each usable or with the reason why not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, TypeAlias, final

Source: TypeAlias = Literal["krl", "rapid", "fanuc", "listing", "lists", "table"]
"""The kind of text of a list. Programs and lists of numbers have decimal points and a unit by definition."""

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
