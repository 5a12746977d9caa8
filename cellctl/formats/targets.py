"""Target files: target poses of the TCP as CSV, read for `compensate` and written by `plan`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import final

import numpy as np

from cellctl.files import InputError, Problem
from cellctl.formats.dataset import DataSet, Sieve, joint_readings, text_of
from cellctl.kinematics import Floats, abc_from_rotation, pose, rotation_from_abc, rotation_from_quaternion
from cellctl.planning import TargetSet
from cellctl.robot_file import RobotFile

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


NOMINAL = tuple(f"nominal_{name}" for name in "XYZABC")
MEASURED = ("X", "Y", "Z")


def targets_text(targets: TargetSet) -> str:
    """CSV: name, A1…An (deg), nominal_X … nominal_C (mm, deg), set if some are held out, and empty X, Y, Z.

    The empty columns are for the measurement. The nominal ones have other names: a fit cannot take them for measured.
    """
    nominal = np.column_stack([targets.poses[:, :3, 3], abc_from_rotation(targets.poses[:, :3, :3])])
    judged = bool(targets.held_out.any())
    axes = [f"A{number}" for number in range(1, targets.readings.shape[1] + 1)]
    digits = len(str(len(targets)))
    rows = []
    for number, (readings, place, test) in enumerate(
        zip(targets.readings.tolist(), np.round(nominal, 4).tolist(), targets.held_out.tolist(), strict=True), 1
    ):
        row = {"name": f"T{number:0{digits}}", **dict(zip(axes, readings, strict=True))}
        row |= dict(zip(NOMINAL, place, strict=True))
        rows.append(row | ({"set": "test" if test else "fit"} if judged else {}) | dict.fromkeys(MEASURED))
    return text_of(rows)


def read_path(file: Path) -> Floats:
    """Points (P, 3), mm, of a path from the columns X, Y, Z of a CSV.

    Raises InputError with every row that cannot be used, for fewer than two points, or a path without length.
    """
    data = DataSet.load(file)
    if missing := [name for name in MEASURED if not data.has(name)]:
        what = f"has no column {', '.join(missing)}"
        raise InputError(Problem(data.file, 1, 0, what, "X, Y, Z in mm: the TCP along the path"))
    sieve = Sieve(data)
    points = np.array([sieve.numbers(name) for name in MEASURED]).T
    if sieve.rejected():
        raise InputError(Problem(data.file, row.line, 0, row.reason) for row in sieve.rejected())
    if len(points) < 2 or np.ptp(points, axis=0).max() < 1e-6:
        raise InputError(Problem(data.file, 0, 0, "is no path: it has no length", "give two different points or more"))
    return points
