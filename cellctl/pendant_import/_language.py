"""What a program language is to the import: how its texts are recognised, and read as postures and as targets."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import final

from cellctl.pendant_import._points import Raw, RawList, Source, Taught
from cellctl.pendant_import.choices import Length, Orientation


@final
@dataclass(frozen=True, slots=True)
class Targets:
    """Cartesian points as text. orientation: how their angles are meant; length: the unit of X, Y, Z.

    postures: columns with the joints of the same points, none where not all have them.
    """

    raw: RawList
    orientation: Orientation
    length: Length = "mm"
    postures: tuple[str, ...] = ()


@final
@dataclass(frozen=True, slots=True, kw_only=True)
class Language:
    """One language of programs, or of lists that a pendant shows.

    postures(text, file, joints): the joint readings of a text; joints: how many the robot has, None: not known.
    targets(text, file): its Cartesian points. Both are None for a text that is not of this language.
    """

    postures: Callable[[str, str, int | None], RawList | None]
    targets: Callable[[str, str], Targets | None]


def postures_of(
    file: str, source: Source, points: Sequence[Taught], decided: Sequence[str], unit: str = "deg"
) -> RawList:
    """The joints of `points`, each axis in `unit`."""
    raw = without_doubles([point.posture() for point in points])
    axes = sorted({label for point in raw for label in point.texts})
    return RawList(file, source, raw, dict.fromkeys(axes, unit), tuple(decided))


def targets_of(file: str, source: Source, points: Sequence[Taught], decided: Sequence[str]) -> RawList:
    """The poses of `points`."""
    raw = without_doubles([point.target() for point in points])
    return RawList(file, source, raw, {}, tuple(decided))


def without_doubles(points: Sequence[Raw]) -> tuple[Raw, ...]:
    """Without `Waypoint_1_p` where `Waypoint_1_q` is wanted and there, or the reverse."""
    good = {point.name for point in points if point.name and not point.fault}
    return tuple(point for point in points if not (point.fault and point.name in good))
