"""Columns of a data set: of places and orientations, σ and covariances; σ and covariances as numbers."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Sequence

import numpy as np

from cellctl.formats.dataset import DataSet, Sieve
from cellctl.kinematics import Floats
from cellctl.robot_file import RobotFile

PLACE = ("X", "Y", "Z")
ABC = ("A", "B", "C")
QUATERNION = ("QW", "QX", "QY", "QZ")

ROTATION_SIGMA_DEG = 0.005
"""σ of a measured orientation about each axis where the data do not state it; it is scaled by the residuals like all
σ."""

LEAST = 1e-6
"""No standard deviation is smaller, mm or degrees: such a row would dominate all others."""

MOST = 1e3
"""No standard deviation is greater, mm or degrees: a larger one is no measurement."""

SIGMA_COLUMNS = ("sX", "sY", "sZ")
OF_DISTANCE = "sD"
OF_ROTATION = "sR"
OF_ZERO = "sZero"
ROTATION_SIGMAS = ("sRX", "sRY", "sRZ")

AXES = ("X", "Y", "Z", "RX", "RY", "RZ")
COVARIANCES = tuple(f"c{one}{other}" for one, other in itertools.combinations(AXES, 2))
"""Columns of covariances between two numbers of a row: mm², mm·deg or deg²."""


def has_own_sigma(data: DataSet) -> bool:
    """Whether any row states the σ of its position or distance."""
    return any(any(data.texts(name)) for name in (*SIGMA_COLUMNS, OF_DISTANCE))


def place_sigma(sieve: Sieve, robot: RobotFile, rows: Collection[int]) -> Floats:
    """σ of each coordinate (N, 3), mm: sX, sY, sZ, or the robot's repeatability on one axis."""
    default = robot.repeatability / math.sqrt(3.0)
    return np.array([_positive(sieve, name, rows, default) for name in SIGMA_COLUMNS]).T


def distance_sigma(sieve: Sieve, robot: RobotFile, rows: Collection[int]) -> Floats:
    """σ along the line measured (N, 1), mm: sD, or that of the place on one axis."""
    of_place = np.sqrt(np.mean(place_sigma(sieve, robot, rows) ** 2, axis=1))
    own = np.array(_positive(sieve, OF_DISTANCE, rows, math.inf))
    return np.where(np.isfinite(own), own, of_place)[:, None]


def rotation_sigma(sieve: Sieve, rows: Collection[int]) -> Floats:
    """σ about each axis (N, 3), rad: sRX, sRY, sRZ, or sR (deg)."""
    common = np.array(_positive(sieve, OF_ROTATION, rows, ROTATION_SIGMA_DEG))
    own = np.array([_positive(sieve, name, rows, math.inf) for name in ROTATION_SIGMAS]).T
    return np.deg2rad(np.where(np.isfinite(own), own, common[:, None]))


def zero_sigmas(sieve: Sieve, zeros: Sequence[str], names: Sequence[str]) -> tuple[float, ...]:
    """Prior σ of each zero of `names` (D,) about 0, mm: the smallest sZero of its rows, `MOST` if none of them has one;
    () if no row at all has one.

    zeros (N): name of each row's zero, empty where it has none.
    """
    rows = {row for row, zero in enumerate(zeros) if zero}
    if not any(sieve.data.texts(OF_ZERO)):
        return ()
    stated = _positive(sieve, OF_ZERO, rows, MOST)
    return tuple(min(stated[row] for row in rows if zeros[row] == name and stated[row] > 0.0) for name in names)


def covariances(sieve: Sieve, sigma: Floats, rows: Collection[int]) -> Floats | None:
    """Covariances (N, k, k) of rows with standard deviations `sigma` (N, k), mm and rad; None where none is stated.

    k = 3: cXY, cXZ, cYZ; k = 6: also those of turns about X, Y, Z. Missing: 0. A row whose covariance is not positive
    definite is rejected.
    """
    size = sigma.shape[1]
    stated = [name for name in COVARIANCES if any(sieve.data.texts(name))]
    unit = np.append(np.ones(3), np.full(3, np.deg2rad(1.0)))
    pairs = [(i, j) for i, j in itertools.combinations(range(size), 2) if f"c{AXES[i]}{AXES[j]}" in stated]
    if not pairs:
        return None
    result = sigma[:, :, None] ** 2 * np.eye(size)
    for i, j in pairs:
        values = np.array(sieve.numbers(f"c{AXES[i]}{AXES[j]}", missing=0.0, rows=rows)) * unit[i] * unit[j]
        result[:, i, j] = result[:, j, i] = values
    for row in sorted(rows):
        if np.isfinite(result[row]).all():
            correlation = result[row] / np.outer(sigma[row], sigma[row])
            if np.linalg.eigvalsh(correlation)[0] < 1e-9:
                names = ", ".join(f"c{AXES[i]}{AXES[j]}" for i, j in pairs)
                sieve.reject(row, f"{names} are too large for the row's standard deviations: no such covariance exists")
    return result


def _positive(sieve: Sieve, name: str, rows: Collection[int], default: float) -> list[float]:
    values = sieve.numbers(name, missing=default, rows=rows)
    for row, value in enumerate(values):
        if value <= 0.0:
            sieve.reject(row, f"{name} is {value:g}: a standard deviation is above 0")
        elif value < LEAST:
            sieve.reject(row, f"{name} is {value:g}: nothing is measured to less than {LEAST:g}")
        elif MOST < value < math.inf:  # infinite: missing
            sieve.reject(row, f"{name} is {value:g}: what is known no better than {MOST:g} is not measured")
    return values
