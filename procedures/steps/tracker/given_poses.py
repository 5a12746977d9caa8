"""Measuring poses from a file of targets, as `cellctl plan` writes it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import numpy as np

from cellctl.files import InputError, Problem
from cellctl.formats import DataSet, RobotFile
from cellctl.formats.columns import Sieve, joint_readings
from cellctl.kinematics import Floats
from cellctl.planning.measuring_poses import MeasuringPoses, Unmeasurable
from cellctl.procedure import CellContext

_CURE = "plan the targets for this cell's station and reflector, or move the station"


class Given(Protocol):
    """The settings of the step."""

    @property
    def pose_file(self) -> str:
        """The file, from the cell file's folder."""

    @property
    def fit(self) -> int:
        """How many of set `fit`, the first ones."""

    @property
    def held_out(self) -> int:
        """How many of set `test`, the first ones."""


def given_poses(
    context: CellContext, robot: RobotFile, wanted: Given, planned: Callable[[Floats], MeasuringPoses]
) -> MeasuringPoses:
    """The visits to the file's postures, by `planned`. Raises InputError: the file has too few, or one of them cannot
    be measured.
    """
    data = DataSet.load(Path(context.cell.file).parent / wanted.pose_file)
    readings, lines = _postures(data, robot, wanted)
    try:
        return planned(readings)
    except Unmeasurable as error:
        raise InputError(
            Problem(data.file, lines[place], 0, f"cannot be measured: {reason}", _CURE)
            for place, reason in error.reasons.items()
        ) from error


def _postures(data: DataSet, robot: RobotFile, wanted: Given) -> tuple[Floats, list[int]]:
    """Postures (fit + held_out, n), deg, those of the fit first, and their lines."""
    sieve = Sieve(data)
    readings = joint_readings(sieve, robot)
    if sieve.rejected():
        raise InputError(Problem(data.file, row.line, 0, row.reason) for row in sieve.rejected())
    sets, chosen = np.array(data.texts("set")), []
    for name, count in (("fit", wanted.fit), ("test", wanted.held_out)):
        places = np.flatnonzero(sets == name)
        if len(places) < count:
            what = f"has {len(places)} targets of set '{name}'; the procedure measures {count}"
            raise InputError(Problem(data.file, 0, 0, what, "plan more of them, or ask for fewer poses"))
        chosen.extend(places[:count].tolist())
    return readings[chosen], [data.lines[place] for place in chosen]
