"""Columns of a data set as numbers, row by row usable or rejected with the reason."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, final

from cellctl.files import InputError, Problem
from cellctl.formats.dataset import DataSet, Rejected

if TYPE_CHECKING:
    from cellctl.formats.robot import RobotFile
    from cellctl.kinematics import Floats

BEYOND_LIMITS_DEG = 5.0
"""A joint reading further than this outside the robot file's limits is no reading of this robot."""


@final
class Sieve:
    """The rows of a data set that are still usable; each that is not keeps the first reason found."""

    def __init__(self, data: DataSet) -> None:
        self.data = data
        self._reasons: dict[int, str] = {}

    def reject(self, row: int, reason: str) -> None:
        """Row `row` (from 0) cannot be used."""
        self._reasons.setdefault(row, reason)

    def numbers(self, name: str, *, missing: float | None = None, rows: Collection[int] | None = None) -> list[float]:
        """A column's numbers (N,); rows with none (unless `missing` stands for it), text, NaN or infinity are rejected.

        rows: the only ones to be looked at; NaN for the others.
        """
        return [
            self._number(row, name, text, missing) if rows is None or row in rows else math.nan
            for row, text in enumerate(self.data.texts(name))
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

    def _number(self, row: int, name: str, text: str, missing: float | None) -> float:
        if not text:
            if missing is None:
                self.reject(row, f"{name} is missing")
            return math.nan if missing is None else missing
        try:
            value = float(text if "_" not in text else "text")  # 1_000 is Python's own way to write a number
        except ValueError:
            self.reject(row, f"{name} '{text[:20]}' is not a number")
            return math.nan
        if not math.isfinite(value):
            self.reject(row, f"{name} is {text}")
        return value


def joint_readings(sieve: Sieve, robot: RobotFile) -> Floats:
    """Controller readings (N, n), deg, from `A1…An` (deg) or `q1…qn` (rad); NaN in rejected rows.

    Raises InputError where neither kind is complete, or both are there.
    """
    import numpy as np

    degrees, radians = ([f"{letter}{number}" for number in range(1, robot.n + 1)] for letter in "Aq")
    names = _one_kind(sieve.data, degrees, radians)
    readings = np.array([sieve.numbers(name) for name in names]).T
    if names is radians:
        readings = np.rad2deg(readings)
    beyond = np.maximum(readings - robot.limits()[:, 1], robot.limits()[:, 0] - readings)
    for row, joint in np.argwhere(beyond > BEYOND_LIMITS_DEG):
        limits = robot.joints[joint]
        what = f"{names[joint]} is {readings[row, joint]:.6g}°, outside {limits.min:g}…{limits.max:g}°"
        sieve.reject(int(row), what)
    return readings


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
