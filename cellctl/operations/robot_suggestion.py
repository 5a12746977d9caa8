"""Which robots of the library a data set can be of: by joints, limits, and the error of a fit of base and tool."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias, final

import numpy as np
from pydantic import computed_field

from cellctl.files import InputError
from cellctl.formats import Artefact, RobotFile, measurements
from cellctl.formats.dataset import DataSet, joints_of
from cellctl.operations.robot_library import robots
from cellctl.robot_file import Tool
from cellctl.setup_check.hypothesis import Setup
from cellctl.setup_check.misfit import misfit

Certainty: TypeAlias = Literal["clear", "several", "none"]


ROWS = 80
"""Rows that are tried, evenly spread."""


CLEARLY = 3.0
"""The best robot is clear if the next one is this many times further from the rows."""


NEARER = 2.0
"""A robot of the library is recommended in place of a wrong one if it is this many times nearer to the rows."""


@final
@dataclass(frozen=True, slots=True)
class Suggestion:
    """A robot of the library. outside: share of the rows with a joint beyond the robot's limits, or unusable.

    rms_mm: error of the nearest 60 % of the rows with base and tool fitted, None where it cannot be computed.
    expected_mm: what the tolerances of such a robot predict. plausible: the error is not far above it.
    """

    name: str
    robot: str
    outside: float
    rms_mm: float | None
    expected_mm: float | None
    plausible: bool


@final
@dataclass(frozen=True, slots=True)
class Suggestions:
    """Robots of the library with the data's number of joints, the best first, and how certain the first one is."""

    robots: Sequence[Suggestion]
    certainty: Certainty

    @computed_field
    @property
    def sentence(self) -> str:
        """How certain it is, in one sentence."""
        if self.certainty == "none":
            return (
                "No robot of the library agrees with these rows: give your own robot file, or check units and signs "
                "of the joints."
            )
        best = self.robots[0]
        error = f"{best.rms_mm:.2g} mm RMS with base and tool fitted"
        if self.certainty == "clear":
            others = [each.rms_mm for each in self.robots[1:] if each.rms_mm is not None]
            beside = f"; the next robot {min(others):.3g} mm" if others else ""
            return f"This is a {best.robot}: {error}{beside}."
        alike = [each.robot for each in self.robots if each.plausible]
        named = ", ".join(alike[1:4])
        return f"Most likely a {best.robot} ({error}). The rows do not exclude {named}: look at the type plate."


def suggest_robots(data: DataSet, artefact: Artefact | None = None, tool: Tool | None = None) -> Suggestions:
    """The robots of the library, ranked by how well they agree with a sample of the rows; tool: what they carry."""
    joints, _ = joints_of(data)
    sample = sample_of(data)
    carried = {"tool": tool} if tool else {}
    alike = [(each.name, each.robot.model_copy(update=carried)) for each in robots() if each.robot.n == joints]
    tried = [_tried(name, robot, sample, artefact) for name, robot in alike]
    found = sorted(filter(None, tried), key=lambda each: (not each.plausible, round(each.outside, 1), _size(each)))
    return Suggestions(found, _certainty(found))


def nearer_robots(robot: RobotFile, data: DataSet, artefact: Artefact | None = None) -> Suggestions | None:
    """The robots of the library with the tool of `robot`; None where the best of them is not clearly nearer."""
    given = _tried("", robot, sample_of(data), artefact)
    found = suggest_robots(data, artefact, robot.tool)
    if given is None or found.certainty == "none" or _size(given) < NEARER * _size(found.robots[0]):
        return None
    return found


def doubt_of(robot: RobotFile, data: DataSet, artefact: Artefact | None = None) -> str:
    """Why the rows are hardly of this robot, in one sentence; empty where they can be.

    The set-up check lets a fit begin whose result is far from the robot file: here a person can still choose another.
    """
    found = _tried("", robot, sample_of(data), artefact)
    if found is None or found.plausible or found.rms_mm is None:
        return ""
    return (
        f"Is this the robot that was measured? With base and tool fitted, the {found.robot} is {found.rms_mm:.3g} mm "
        f"(RMS) from the rows; its tolerances predict {found.expected_mm:.2g} mm."
    )


def _certainty(found: Sequence[Suggestion]) -> Certainty:
    if not found or not found[0].plausible:
        return "none"
    plausible = [each for each in found if each.plausible]
    clear = len(plausible) == 1 or _size(plausible[1]) > CLEARLY * _size(plausible[0])
    return "clear" if clear else "several"


def _size(one: Suggestion) -> float:
    return float("inf") if one.rms_mm is None else one.rms_mm


def sample_of(data: DataSet, most: int = ROWS) -> DataSet:
    """At most so many rows, evenly spread."""
    step = max(len(data) / most, 1.0)
    rows = sorted({int(number * step) for number in range(min(most, len(data)))})
    return replace(
        data, cells=tuple(data.cells[row] for row in rows), lines=tuple(data.lines[row] for row in rows), rejected=()
    )


def _tried(name: str, robot: RobotFile, sample: DataSet, artefact: Artefact | None) -> Suggestion | None:
    """None where no row can be of this robot."""
    try:
        rows = measurements(robot, sample, model="registration", artefact=artefact)
    except InputError:
        return None
    outside = 1.0 - len(rows.lines) / len(sample)
    if rows.task.rows.size < 2 * rows.task.n_registration:
        return Suggestion(name, robot.name, outside, None, None, False)
    setup = Setup(rows.task, robot.joint_map(), rows.readings)
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            found = misfit(setup).with_prediction(setup)
    except np.linalg.LinAlgError:
        return Suggestion(name, robot.name, outside, None, None, False)
    plausible = not found.implausible and outside < 0.5
    return Suggestion(name, robot.name, outside, found.mm, found.predicted_mm, plausible)
