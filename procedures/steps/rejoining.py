"""Rejoins a path: a robot that was interrupted on a planned path continues from the nearest earlier point.

A path is a list of joint readings between which the controller moves in straight joint-space lines, so a robot that
was stopped on it is on one of these lines. Otherwise it was moved by hand, and a person must decide how it may move.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import dist

from cellctl.devices import DeviceRefused, JointReadings, MovingRobot

ON_THE_WAY_DEG = 1.0
"""Largest distance from a planned line, as norm of the joint vector, that counts as on it (braking, following lag)."""

AT_A_POINT_DEG = 0.2
"""Within this distance of a point of the path, the robot counts as there."""


async def rejoin(
    robot: MovingRobot, way: Sequence[JointReadings], speed_percent: float, here: JointReadings | None = None
) -> int:
    """Move the robot back along `way` to one of its points; returns the index. here: None: its actual joints.

    Does not move if it is at the first point. Raises DeviceRefused if it is off the path; DeviceLost.
    """
    here = here or await robot.joints()
    index = last_point_before(way, here)
    if index is None:
        raise DeviceRefused(
            robot.name,
            f"is off its planned way, at {', '.join(f'{angle:.1f}' for angle in here)} deg",
            f"Move it by hand (T1), clear of everything, to {', '.join(f'{angle:.1f}' for angle in way[0])} deg.",
        )
    if index > 0 or dist(here, way[0]) > AT_A_POINT_DEG:
        await robot.move(tuple(way[index]), speed_percent)
    return index


def last_point_before(way: Sequence[JointReadings], here: JointReadings) -> int | None:
    """Index of the point of `way` that a robot at `here` passed last; None if it is off the path.

    If it is on several lines (the path crosses itself), the earliest counts: from there the whole path is planned.
    """
    if dist(here, way[0]) <= AT_A_POINT_DEG:
        return 0
    for index, (start, end) in enumerate(pairwise(way)):
        if _from_line(start, end, here) <= ON_THE_WAY_DEG:
            return index + 1 if dist(here, end) <= AT_A_POINT_DEG else index
    return None


def _from_line(start: JointReadings, end: JointReadings, here: JointReadings) -> float:
    """Distance of `here` from the straight joint-space line between `start` and `end`, degrees."""
    along = [b - a for a, b in zip(start, end, strict=True)]
    length = sum(step * step for step in along)
    if length == 0.0:
        return dist(here, start)
    share = sum((h - a) * step for h, a, step in zip(here, start, along, strict=True)) / length
    share = min(1.0, max(0.0, share))
    return dist(here, [a + share * step for a, step in zip(start, along, strict=True)])
