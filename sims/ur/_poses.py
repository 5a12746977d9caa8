"""Poses of URScript, p[x, y, z, rx, ry, rz]: metres, and a rotation vector in radians."""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, cos, hypot, pi, sin

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]
Pose = tuple[float, float, float, float, float, float]

NO_TOOL: Pose = (0.0,) * 6


def matrix_of(pose: Sequence[float]) -> Matrix:
    """4×4 of a pose, metres."""
    out = np.eye(4)
    out[:3, :3] = rotation_of(pose[3:])
    out[:3, 3] = pose[:3]
    return out


def rotation_of(vector: Sequence[float] | Matrix) -> Matrix:
    """3×3 of a rotation vector, rad (Rodrigues)."""
    x, y, z = (float(part) for part in vector)
    angle = (x * x + y * y + z * z) ** 0.5
    if angle < 1e-15:
        return np.eye(3)
    x, y, z = x / angle, y / angle, z / angle
    c, s = cos(angle), sin(angle)
    k = 1.0 - c
    return np.array(
        [
            [c + k * x * x, k * x * y - s * z, k * x * z + s * y],
            [k * x * y + s * z, c + k * y * y, k * y * z - s * x],
            [k * x * z - s * y, k * y * z + s * x, c + k * z * z],
        ]
    )


def vector_of(rotation: Matrix) -> tuple[float, float, float]:
    """The rotation vector of a 3×3 rotation, no longer than π."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation.tolist()
    x, y, z = (zy - yz) / 2.0, (xz - zx) / 2.0, (yx - xy) / 2.0
    sine, cosine = hypot(x, y, z), (xx + yy + zz - 1.0) / 2.0
    if sine > 1e-6:
        factor = atan2(sine, cosine) / sine
        return x * factor, y * factor, z * factor
    if cosine > 0.0:
        return x, y, z
    # half a turn: the axis is the longest column of R + 1
    longest = max(((xx + 1.0, yx, zx), (xy, yy + 1.0, zy), (xz, yz, zz + 1.0)), key=lambda column: hypot(*column))
    factor = pi / hypot(*longest)
    return longest[0] * factor, longest[1] * factor, longest[2] * factor


def pose_of(matrix: Matrix) -> Pose:
    """The pose of a 4×4, metres."""
    x, y, z = matrix[:3, 3].tolist()
    return x, y, z, *vector_of(matrix[:3, :3])


def trans(first: Sequence[float], then: Sequence[float]) -> Pose:
    """`pose_trans`: the second pose, given in the first."""
    return pose_of(matrix_of(first) @ matrix_of(then))


def inverse(pose: Sequence[float]) -> Pose:
    """`pose_inv`."""
    return pose_of(inverse_matrix(matrix_of(pose)))


def inverse_matrix(matrix: Matrix) -> Matrix:
    """Of a 4×4 rigid motion."""
    out = np.eye(4)
    out[:3, :3] = matrix[:3, :3].T
    out[:3, 3] = -matrix[:3, :3].T @ matrix[:3, 3]
    return out


def between(start: Sequence[float], end: Sequence[float], share: float) -> Pose:
    """`interpolate_pose`: straight, turning about one axis; `share` 0 … 1."""
    a, b = matrix_of(start), matrix_of(end)
    turn = np.array(vector_of(a[:3, :3].T @ b[:3, :3]))
    out = np.eye(4)
    out[:3, :3] = a[:3, :3] @ rotation_of(share * turn)
    out[:3, 3] = a[:3, 3] + share * (b[:3, 3] - a[:3, 3])
    return pose_of(out)
