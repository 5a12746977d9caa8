"""Checks for impossible content of a robot file: every error with its place."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from cellctl.files import Document, Problem

if TYPE_CHECKING:
    from cellctl.formats.robot import LinkRow, RobotFile

_FORMS = {"mdh-hayati": ("links",), "dh-craig": ("links",), "poe": ("screws", "home")}
"""The sections with a robot's geometry, by convention."""

PARALLEL_DEG = 1.0
"""Axes at a smaller angle to each other count as parallel."""


def form_problems(document: Document) -> list[Problem]:
    """Missing sections of the convention, and sections of another convention."""
    data = document.data if isinstance(document.data, dict) else {}
    convention = data.get("convention")
    if convention not in _FORMS:
        return []
    needed, all_forms = _FORMS[convention], dict.fromkeys(name for names in _FORMS.values() for name in names)
    problems = []
    for name in all_forms:
        if name in needed and not data.get(name):
            cure = f"convention {convention} is given by {' and '.join(needed)}"
            problems.append(document.problem((name,), f"'{name}' is missing", cure, key=True))
        elif name not in needed and name in data:
            cure = f"convention {convention} is given by {' and '.join(needed)}: remove one of the two"
            problems.append(document.problem((name,), f"'{name}' does not go with {convention}", cure, key=True))
    return problems


def contradictions(document: Document, robot: RobotFile) -> list[Problem]:
    """Errors in well-formed content."""
    return [*_counts(document, robot), *_limits(document, robot), *_table(document, robot), *_axes(document, robot)]


def looks_like_radians(angle: float | None) -> bool:
    """Whether an angle in degrees is a multiple of a quarter turn in radians: 1.571, −3.1416, 4.71239."""
    quarters = round(abs(angle or 0.0) / (math.pi / 2))
    if not 1 <= quarters <= 4:
        return False
    exact = quarters * math.pi / 2
    return any(abs(abs(angle or 0.0) - round(exact, digits)) < 1e-12 for digits in range(3, 17))


def parallel_to_neighbour(convention: str, alpha_deg: float, index: int, n: int) -> bool:
    """Whether row `index` (from 0) of `n` has its alpha between two joints, and leaves their axes parallel."""
    between = index < n - 1 if convention == "mdh-hayati" else index > 0
    return between and abs(math.sin(math.radians(alpha_deg))) < math.sin(math.radians(PARALLEL_DEG))


def _counts(document: Document, robot: RobotFile) -> list[Problem]:
    if len(robot.joints) == robot.n:
        return []
    rows = "screws" if robot.convention == "poe" else "links"
    what = f"{len(robot.joints)} joints for {robot.n} {rows}"
    return [document.problem(("joints",), what, f"one row in joints for each row in {rows}", key=True)]


def _limits(document: Document, robot: RobotFile) -> list[Problem]:
    return [
        document.problem(("joints", index, "min"), f"joint {index + 1}: min {row.min:g} is not below max {row.max:g}")
        for index, row in enumerate(robot.joints)
        if row.min >= row.max
    ]


def _table(document: Document, robot: RobotFile) -> list[Problem]:
    problems = []
    for index, row in enumerate(robot.links):
        problems += _radians(document, row, index)
        if row.beta is None and parallel_to_neighbour(robot.convention, row.alpha, index, robot.n):
            what = f"link {index + 1}: its two axes are parallel: its d cannot be distinguished from its neighbour's"
            problems.append(document.problem(("links", index), what, "add 'beta: 0' to this link"))
    return problems


def _radians(document: Document, row: LinkRow, index: int) -> list[Problem]:
    return [
        document.problem(
            ("links", index, name),
            f"link {index + 1}: {name} {getattr(row, name):g} looks like radians",
            "write degrees",
        )
        for name in ("theta", "alpha", "beta")
        if looks_like_radians(getattr(row, name))
    ]


def _axes(document: Document, robot: RobotFile) -> list[Problem]:
    return [
        document.problem(
            ("screws", index, "axis"), f"screw {index + 1}: its axis has no direction", "three numbers, not all 0"
        )
        for index, row in enumerate(robot.screws)
        if not any(row.axis)
    ]
