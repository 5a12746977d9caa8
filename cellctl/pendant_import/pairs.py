"""The result of pairing: pairs of posture and position, and the rows of both files that are in no pair."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Self, TypeAlias, final

from cellctl.pendant_import.points import Point, PointList

Pair: TypeAlias = tuple[Point, Point]
"""A posture and its position."""


@final
@dataclass(frozen=True, slots=True)
class LeftOut:
    """A row of either file that is in no pair, and why."""

    file: str
    line: int
    name: str
    reason: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.name + ': ' if self.name else ''}{self.reason}"


@final
@dataclass(frozen=True, slots=True)
class Pairing:
    """Pairs of posture and position in the order of the positions, rows left out, and how they were paired."""

    pairs: tuple[Pair, ...]
    left_out: tuple[LeftOut, ...]
    decided: tuple[str, ...]

    @classmethod
    def of(cls, pairs: Iterable[Pair], left: Iterable[LeftOut], decided: Iterable[str]) -> Self:
        """A pairing with the rows left out sorted by file and line."""
        return cls(tuple(pairs), tuple(sorted(left, key=lambda row: (row.file, row.line))), tuple(decided))


def left_out(points: PointList, point: Point, reason: str) -> LeftOut:
    """A point that is in no pair."""
    return LeftOut(points.file, point.line, point.name, reason)
