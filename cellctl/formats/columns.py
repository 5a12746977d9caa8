"""Columns of a data set as numbers, row by row usable or rejected with the reason."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, final

from cellctl.files import InputError, Problem
from cellctl.formats.dataset import Cell, DataSet, Rejected

if TYPE_CHECKING:
    from cellctl.formats.robot import RobotFile
    from cellctl.kinematics import Bools, Floats

BEYOND_LIMITS_DEG = 5.0
"""A joint reading further than this outside the robot file's limits cannot be this robot's."""

BEYOND = 5e5
"""No number of a data set is larger: 500 m, where all lengths are mm. A larger one would dominate all other rows."""

MOST_RADIANS = 6.6
"""Readings beyond this, in most rows, are probably not radians: more than a turn."""


@final
class Sieve:
    """The rows of a data set that are still usable; each rejected one keeps its first reason."""

    def __init__(self, data: DataSet) -> None:
        self.data = data
        self._reasons: dict[int, str] = {}

    def reject(self, row: int, reason: str) -> None:
        """Row `row` (from 0) cannot be used."""
        self._reasons.setdefault(row, reason)

    def numbers(self, name: str, *, missing: float | None = None, rows: Collection[int] | None = None) -> list[float]:
        """A column's numbers (N,); rejected are rows with none (unless `missing` replaces it), text, NaN, infinity or a
        number that is too large.

        rows: only these are read; NaN for the others.
        """
        return [
            self._number(row, name, cell, missing) if rows is None or row in rows else math.nan
            for row, cell in enumerate(self.data.values(name))
        ]

    def kept(self) -> list[int]:
        """The usable rows (from 0), in order. Raises InputError where there is none, with the reasons."""
        kept = [row for row in range(len(self.data)) if row not in self._reasons]
        if kept:
            return kept
        some = [Problem(self.data.file, reject.line, 0, reject.reason) for reject in self.rejected()[:10]]
        raise InputError([Problem(self.data.file, 0, 0, "holds no row that can be used"), *some])

    def rejected(self) -> list[Rejected]:
        """All rejected rows, those of the file's own reading included, by line."""
        mine = [Rejected(self.data.lines[row], reason) for row, reason in self._reasons.items()]
        return sorted([*self.data.rejected, *mine], key=lambda rejected: rejected.line)

    def _number(self, row: int, name: str, cell: Cell, missing: float | None) -> float:
        text = str(cell)
        if not text:
            if missing is None:
                self.reject(row, f"{name} is missing")
            return math.nan if missing is None else missing
        try:
            value = float(cell if "_" not in text else "text")  # 1_000 is Python's own way to write a number
        except ValueError:
            self.reject(row, f"{name} '{text[:20]}' is not a number")
            return math.nan
        if not math.isfinite(value):
            self.reject(row, f"{name} is {text}")
        elif abs(value) > BEYOND:
            self.reject(row, f"{name} is {text[:20]}: no robot is measured by numbers beyond {BEYOND:.0f}")
            return math.nan
        return value


def joint_readings(sieve: Sieve, robot: RobotFile) -> Floats:
    """Controller readings (N, n), deg, from `A1…An` (deg) or `q1…qn` (rad); NaN in rejected rows.

    Raises InputError where neither kind is complete, or both are there, or `q1…qn` hold degrees.
    """
    import numpy as np

    degrees, radians = ([f"{letter}{number}" for number in range(1, robot.n + 1)] for letter in "Aq")
    names = _one_kind(sieve.data, degrees, radians)
    readings = np.array([sieve.numbers(name) for name in names]).T
    if names is radians:
        _refuse_degrees(sieve, robot, readings, names)
        readings = np.rad2deg(readings)
    for row, joint in np.argwhere(_beyond_limits(robot, readings)):
        limits = robot.joints[joint]
        what = f"{names[joint]} is {readings[row, joint]:.6g}°, outside {limits.min:g}…{limits.max:g}°"
        sieve.reject(int(row), what)
    return readings


def _beyond_limits(robot: RobotFile, degrees: Floats) -> Bools:
    """Which readings (N, n) this robot cannot have; NaN counts as possible."""
    import numpy as np

    limits = robot.limits()
    return np.asarray(np.maximum(degrees - limits[:, 1], limits[:, 0] - degrees) > BEYOND_LIMITS_DEG)


def _refuse_degrees(sieve: Sieve, robot: RobotFile, given: Floats, names: Sequence[str]) -> None:
    """Raise InputError where most rows (N, n) cannot be this robot's radians, and nearly all of these can be its
    degrees.
    """
    import numpy as np

    read = np.isfinite(given).all(axis=1)
    beyond = read & _beyond_limits(robot, np.rad2deg(given)).any(axis=1)
    turns = beyond & (np.abs(given) > MOST_RADIANS).any(axis=1)
    degrees = turns & ~_beyond_limits(robot, given).any(axis=1)
    wrong, right = int(np.count_nonzero(beyond)), int(np.count_nonzero(degrees))
    if 2 * wrong > np.count_nonzero(read) and right >= 0.9 * wrong:
        rows = f"{wrong} of {len(given)} rows are outside the joints' limits as radians"
        what = f"{names[0]}…{names[-1]} are degrees: {rows}, {right} of these inside as degrees"
        cure = f"name the columns A1…A{len(names)}, which are in degrees, or write radians"
        raise InputError(Problem(sieve.data.file, 1, 0, what, cure))


def _one_kind(data: DataSet, degrees: Sequence[str], radians: Sequence[str]) -> Sequence[str]:
    found = [names for names in (degrees, radians) if data.has(*names)]
    if len(found) == 1:
        return found[0]
    if found:
        what = f"has both {degrees[0]}… (degrees) and {radians[0]}… (radians)"
        raise InputError(Problem(data.file, 1, 0, what, "keep one kind"))
    what = (
        f"has no complete set of joint readings: {degrees[0]}…{degrees[-1]} (deg) or {radians[0]}…{radians[-1]} (rad)"
    )
    lacking = [name for name in degrees if not data.has(name)]
    cure = f"missing: {', '.join(lacking)}" if len(lacking) < len(degrees) else f"columns here: {_some(data.columns)}"
    raise InputError(Problem(data.file, 1, 0, what, cure))


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:12]) + (", …" if len(names) > 12 else "")
