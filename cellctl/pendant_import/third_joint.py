"""The third joint of arms whose controller shows it against the horizontal (FANUC): the angle between the arms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from cellctl.files import InputError, Problem
from cellctl.pendant_import.choices import Choices
from cellctl.pendant_import.points import Point, RawList

if TYPE_CHECKING:
    from cellctl.formats.robot import RobotFile

_CURE = (
    "--j3 horizontal adds J2 to J3 (readings of a FANUC pendant or program), --j3 arm takes J3 as the angle between "
    "the arms"
)


def between_the_arms(
    raw: RawList, points: Sequence[Point], choices: Choices, robot: RobotFile | None
) -> tuple[list[Point], str]:
    """The points with J3 as the angle between the arms, and what was decided.

    A robot file states with `controller_j3: horizontal` in its source that its J3 is that angle and the controller's is
    not. Raises InputError where the list is a FANUC's, or the robot file states this, and it is not certain what J3 is.
    """
    stated = bool(robot and robot.source and robot.source.controller_j3 == "horizontal")
    shown = choices.j3 == "horizontal" or (choices.j3 is None and stated and raw.source == "fanuc")
    if shown:
        how = "--j3" if choices.j3 else "the robot file"
        return [_added(point) for point in points], f"J3 counted from the horizontal, as {how} says: J2 added to it"
    if choices.j3 == "arm":
        return list(points), "J3 is the angle between the arms, as --j3 says"
    if raw.source == "fanuc":
        what = (
            "its J3 counts from the horizontal, as FANUC's controllers show it; no robot file says what a model needs"
        )
        cure = f"--robot with `controller_j3: horizontal` in its source, or {_CURE}"
        raise InputError(Problem(raw.file, 0, 0, what, cure))
    if stated and any(not point.fault for point in points):
        what = "does J3 count from the horizontal, as this robot's controller shows it, or from the arm before it?"
        raise InputError(Problem(raw.file, raw.heading_line, 0, what, _CURE))
    return list(points), ""


def _added(point: Point) -> Point:
    letter = next((letter for letter in "Aq" if f"{letter}3" in point.values), "")
    if point.fault or not letter:
        return point
    total = float(point.values[f"{letter}3"]) + float(point.values[f"{letter}2"])
    return replace(point, values={**point.values, f"{letter}3": round(total, 9)})
