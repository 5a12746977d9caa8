"""Measured reflectors as columns of a data set.

The covariance of a row: of its points for themselves, and the robot's repeatability. The part that all points share
(range zero and scale, refraction, centring) is none of a row's own: more rows do not reduce it.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from scipy.spatial.transform import Rotation

from cellctl.kinematics import Floats
from cellctl.metrology.nests import NestPlate, plate_pose
from procedures.steps.tracker.plate import alone
from procedures.steps.tracker.points import points_of
from procedures.steps.tracker.rows import PoseRow

_NAMES = ("X", "Y", "Z", "RX", "RY", "RZ")


def measured_place(row: PoseRow, repeatability: float) -> dict[str, float]:
    """X, Y, Z, mm, with their covariance; repeatability: of the robot, 3-D, mm."""
    covariance = points_of([row.point]).alone[0] + repeatability**2 / 3.0 * np.eye(3)
    return {**dict(zip("XYZ", row.point.xyz, strict=True)), **_spread(covariance)}


def measured_pose(plate: NestPlate, row: PoseRow, repeatability: float) -> dict[str, float]:
    """X, Y, Z, mm, and the quaternion of the plate's frame, with their covariance, mm and deg."""
    found = plate_pose(alone(points_of([row.point, *row.others])), plate)
    covariance = found.covariance.copy()
    covariance[:3, :3] += repeatability**2 / 3.0 * np.eye(3)
    scale = np.array([1.0] * 3 + [np.degrees(1.0)] * 3)
    w, x, y, z = Rotation.from_matrix(found.matrix[:3, :3]).as_quat(scalar_first=True).tolist()
    return {
        **dict(zip("XYZ", found.matrix[:3, 3].tolist(), strict=True)),
        "QW": w, "QX": x, "QY": y, "QZ": z,
        **_spread(covariance * np.outer(scale, scale)),
    }  # fmt: skip


def _spread(covariance: Floats) -> dict[str, float]:
    """Columns sX … and cXY … of a covariance (k, k)."""
    names = _NAMES[: len(covariance)]
    sigma = {f"s{name}": float(np.sqrt(covariance[at, at])) for at, name in enumerate(names)}
    return sigma | {f"c{names[i]}{names[j]}": float(covariance[i, j]) for i, j in combinations(range(len(names)), 2)}
