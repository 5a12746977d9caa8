"""A robot's reach from the lengths in its file (a driver derives its speed limit from it), and its number of axes."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from cellctl.files import InputError, load_yaml


def reach_of(robot_file: Path) -> float | None:
    """The TCP's greatest distance from the first axis, mm: all links and the tool in one straight line, at most.

    Never less than the true reach. None if the file cannot be read or has no such lengths; loading it as a
    robot file reports its errors.
    """
    try:
        data = load_yaml(robot_file).data
        return sum(_lengths(data)) or None
    except (InputError, AttributeError, KeyError, TypeError, ValueError):
        return None


def axes_of(robot_file: Path) -> int | None:
    """The number of the robot's axes; None if the file cannot be read or is no robot file."""
    try:
        data = load_yaml(robot_file).data
        return len(data.get("links") or data["screws"])
    except (InputError, AttributeError, KeyError, TypeError):
        return None


def _lengths(robot: dict[str, Any]) -> Iterator[float]:
    """Length of each piece from the base to the TCP, mm."""
    for link in robot.get("links", ()):
        yield math.hypot(link.get("a", 0.0), link.get("d", 0.0))
    points = [screw["point"] for screw in robot.get("screws", ())]
    if points:
        flange = robot["home"].get("xyz", (0.0, 0.0, 0.0))
        yield from (math.dist(a, b) for a, b in itertools.pairwise([*points, flange]))
    yield math.hypot(*(robot.get("tool") or {}).get("xyz", (0.0, 0.0, 0.0)))
