"""Target files: target poses of the TCP. CSV, like data sets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, final

from cellctl.files import InputError, Problem
from cellctl.formats.columns import Sieve, joint_readings
from cellctl.formats.dataset import DataSet
from cellctl.formats.robot import RobotFile

if TYPE_CHECKING:
    from cellctl.kinematics import Floats

_ABC = ("A", "B", "C")
_QUATERNION = ("QW", "QX", "QY", "QZ")


@final
@dataclass(frozen=True, eq=False)
class Targets:
    """Targets as read: poses (N, 4, 4), mm; postures (N, n), deg, to start from, or None; lines (N,) of the file."""

    poses: Floats
    postures: Floats | None
    lines: tuple[int, ...]


def read_targets(data: DataSet, robot: RobotFile) -> Targets:
    """Targets from X, Y, Z with A, B, C or QW, QX, QY, QZ; postures from A1…An or q1…qn where these exist.

    Raises InputError with every row that cannot be used: leaving one out would renumber those after it.
    """
    import numpy as np

    from cellctl.kinematics import pose, rotation_from_abc, rotation_from_quaternion

    orientation = _orientation(data)
    sieve = Sieve(data)
    xyz = np.array([sieve.numbers(name) for name in "XYZ"]).T
    turns = np.array([sieve.numbers(name) for name in orientation]).T
    if orientation is _QUATERNION:
        for row in np.flatnonzero(np.abs(np.linalg.norm(turns, axis=1) - 1.0) > 0.01):
            sieve.reject(int(row), "QW, QX, QY, QZ is no unit quaternion")
    postures = joint_readings(sieve, robot) if data.has("A1") or data.has("q1") else None
    if sieve.rejected():
        raise InputError(Problem(data.file, row.line, 0, row.reason) for row in sieve.rejected())
    rotation = rotation_from_quaternion if orientation is _QUATERNION else rotation_from_abc
    return Targets(pose(rotation(turns), xyz), postures, data.lines)


def _orientation(data: DataSet) -> tuple[str, ...]:
    missing = [name for name in "XYZ" if not data.has(name)]
    if missing:
        what = f"has no column {', '.join(missing)}"
        raise InputError(Problem(data.file, 1, 0, what, "X, Y, Z in mm: where the tool centre point shall be"))
    found = [names for names in (_ABC, _QUATERNION) if data.has(*names)]
    if len(found) == 1:
        return found[0]
    what = "has no orientation" if not found else "gives the orientation in two ways"
    raise InputError(Problem(data.file, 1, 0, what, "A, B, C (deg), or QW, QX, QY, QZ"))
