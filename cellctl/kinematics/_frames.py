"""Frames as 4×4 matrices (mm), and KUKA's notation: X, Y, Z and A, B, C with R = Rz(A) Ry(B) Rx(C), degrees.

A pose "of the tool in the base" takes points given in the tool's frame to the base's."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats: TypeAlias = NDArray[np.float64]
"""Array of float64; shapes are stated in docstrings, batches as leading axes `(..., 4, 4)`."""

Bools: TypeAlias = NDArray[np.bool_]
"""Array of truth values."""


_HALF_TURN = 1e-6
"""The sine of a turn below which its symmetric part gives its axis better than the skew part."""


def pose_from_xyz_abc(xyz: ArrayLike, abc: ArrayLike) -> Floats:
    """Pose (..., 4, 4) from position (..., 3), mm, and KUKA angles A, B, C (..., 3), degrees."""
    return pose(rotation_from_abc(abc), xyz)


def pose(rotation: ArrayLike, xyz: ArrayLike) -> Floats:
    """Pose (..., 4, 4) from rotation matrices (..., 3, 3) and positions (..., 3), mm; leading axes broadcast."""
    turn, place = np.asarray(rotation, float), np.asarray(xyz, float)
    batch = np.broadcast_shapes(turn.shape[:-2], place.shape[:-1])
    result = np.zeros((*batch, 4, 4))
    result[..., :3, :3] = turn
    result[..., :3, 3] = place
    result[..., 3, 3] = 1.0
    return result


def rotation_from_abc(abc: ArrayLike) -> Floats:
    """Rotation matrices (..., 3, 3) from KUKA angles A, B, C (..., 3), degrees."""
    angles = np.asarray(abc, float)
    if not angles.any():  # most bases and tools: SciPy is not needed for them
        return np.tile(np.eye(3), (*angles.shape[:-1], 1, 1))
    from scipy.spatial.transform import Rotation  # at first use: it takes 0.2 s

    matrices: Floats = Rotation.from_euler("ZYX", angles.reshape(-1, 3), degrees=True).as_matrix()
    return matrices.reshape((*angles.shape[:-1], 3, 3))


def abc_from_rotation(rotation: ArrayLike) -> Floats:
    """KUKA angles A, B, C (..., 3), degrees, of rotation matrices (..., 3, 3); B in −90…90, at ±90 C is 0.

    They reproduce the matrix to 1e-14, also near ±90°.
    """
    turn = np.asarray(rotation, float)
    flat = np.hypot(turn[..., 0, 0], turn[..., 1, 0])
    b = np.arctan2(-turn[..., 2, 0], flat)
    level = flat > 1e-14
    a = np.where(level, np.arctan2(turn[..., 1, 0], turn[..., 0, 0]), np.arctan2(-turn[..., 0, 1], turn[..., 1, 1]))
    # near B = ±90° A is poorly determined, but A and C together are not: C from the rest after A
    sine, cosine = np.sin(a), np.cos(a)
    c = np.arctan2(sine * turn[..., 0, 2] - cosine * turn[..., 1, 2], cosine * turn[..., 1, 1] - sine * turn[..., 0, 1])
    return np.asarray(np.rad2deg(np.stack([a, b, c], axis=-1)))


def rotation_from_quaternion(wxyz: ArrayLike) -> Floats:
    """Rotation matrices (..., 3, 3) from quaternions W, X, Y, Z (..., 4), of any length but zero (ValueError)."""
    from scipy.spatial.transform import Rotation  # at first use: it takes 0.2 s

    quaternion = np.asarray(wxyz, float)
    matrices = Rotation.from_quat(quaternion.reshape(-1, 4), scalar_first=True).as_matrix()
    return matrices.reshape(*quaternion.shape[:-1], 3, 3)


def inverse_pose(matrix: ArrayLike) -> Floats:
    """The inverse of poses (..., 4, 4)."""
    forward = np.asarray(matrix, float)
    back = np.swapaxes(forward[..., :3, :3], -1, -2)
    return pose(back, -np.einsum("...ij,...j->...i", back, forward[..., :3, 3]))


def pose_difference(goal: Floats, actual: Floats) -> Floats:
    """Shift (mm) and rotation vector (rad) (..., 6) from poses `actual` (..., 4, 4) to `goal`, along the outer frame's
    axes.
    """
    turn = np.matmul(goal[..., :3, :3], np.swapaxes(actual[..., :3, :3], -1, -2))
    return np.concatenate([goal[..., :3, 3] - actual[..., :3, 3], rotation_vector(turn)], axis=-1)


def rotation_vector(rotation: ArrayLike) -> Floats:
    """Axis times angle (..., 3), rad, of rotation matrices (..., 3, 3); the angle in 0…π.

    Through the skew part, which is fast in batches; near π, where that vanishes, through the symmetric one. At π itself
    both senses of the axis are valid.
    """
    turn = np.asarray(rotation, float)
    skew = 0.5 * np.stack(
        [
            turn[..., 2, 1] - turn[..., 1, 2],
            turn[..., 0, 2] - turn[..., 2, 0],
            turn[..., 1, 0] - turn[..., 0, 1],
        ],
        axis=-1,
    )
    sine = np.linalg.norm(skew, axis=-1)
    cosine = 0.5 * (np.trace(turn, axis1=-2, axis2=-1) - 1.0)
    angle = np.arctan2(sine, cosine)
    factor = np.divide(angle, sine, out=np.ones_like(sine), where=sine > 1e-12)
    result = np.asarray(skew * factor[..., None])
    if (half := (cosine < 0.0) & (sine < _HALF_TURN)).any():
        result[half] = angle[half][..., None] * _axis_of_half_turn(turn[half], skew[half])
    return result


def _axis_of_half_turn(turn: Floats, skew: Floats) -> Floats:
    """Unit axes u (N, 3) of turns (N, 3, 3) by almost π, in the sense of `skew` (N, 3).

    The largest column of turn + transpose − 2 cos φ = 2 (1 − cos φ) u uᵀ.
    """
    columns = turn + np.swapaxes(turn, -1, -2) + (1.0 - np.trace(turn, axis1=-2, axis2=-1))[:, None, None] * np.eye(3)
    largest = np.argmax(np.diagonal(columns, axis1=-2, axis2=-1), axis=-1)
    axes = columns[np.arange(len(turn)), :, largest]
    sense = np.where(np.sum(axes * skew, axis=-1) < 0.0, -1.0, 1.0)
    return np.asarray(axes * (sense / np.linalg.norm(axes, axis=-1))[:, None])
