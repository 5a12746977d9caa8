"""Pose and distance performance by ISO 9283: AP, RP, vAP, AD, RD, and the five points of the ISO cube.

An attained pose is (x, y, z, a, b, c): mm, and KUKA angles in degrees. Commands and attained poses are in one frame,
whose registration does not come from the judged points: that would flatter AP. Standard deviations have n − 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.kinematics import Floats

CYCLES = 30
"""Cycles that the standard asks for."""

DIAGONAL_SHARE = 0.10
"""Distance of P2 … P5 from the ends of the diagonals, as a share of their length: (10 ± 2) %."""


@final
@dataclass(frozen=True, eq=False)
class PoseFigures:
    """Of one point. accuracy: AP_p = |m̄ − c|, mm; of_axes (3,): m̄ − c; of_angles (3,): AP_a, AP_b, AP_c, degrees.

    repeatability: RP_l = l̄ + 3 S_l, mm; angle_repeatability (3,): 3 S_a, 3 S_b, 3 S_c, degrees (each ±).
    """

    accuracy: float
    of_axes: Floats
    of_angles: Floats
    repeatability: float
    angle_repeatability: Floats


@final
@dataclass(frozen=True, slots=True)
class DistanceFigures:
    """Between two points: accuracy AD = D̄ − D_c, mm; repeatability RD = 3 S_D, mm (±)."""

    accuracy: float
    repeatability: float


@final
@dataclass(frozen=True, eq=False)
class MultiDirection:
    """Variation of mean poses over directions of approach: position vAP_p, mm; angles (3,), degrees."""

    position: float
    angles: Floats


@final
@dataclass(frozen=True, eq=False)
class Performance:
    """Of a whole test. points: of P1 … P5. distance: between P2 and P4. directions: of P1, P2, P4, if measured.

    cycles: n; `complete` if it is at least what the standard asks for.
    """

    points: tuple[PoseFigures, ...]
    distance: DistanceFigures
    directions: tuple[MultiDirection, ...]
    cycles: int

    @property
    def complete(self) -> bool:
        """Whether there are at least 30 cycles."""
        return self.cycles >= CYCLES


def performance(attained: ArrayLike, commanded: ArrayLike, by_direction: ArrayLike | None = None) -> Performance:
    """All figures of attained poses (cycles, 5, 6) at commands (5, 6).

    by_direction (cycles, directions, 3, 6): attained at P1, P2, P4 from each direction of approach. Raises ValueError
    for other shapes, fewer than two cycles or values that are not finite.
    """
    poses, wanted = _checked(attained), np.asarray(commanded, float)
    if poses.shape[1:] != wanted.shape or wanted.shape != (5, 6):
        raise ValueError(f"ISO 9283 needs poses (cycles, 5, 6) and commands (5, 6), not {poses.shape}, {wanted.shape}")
    varied = np.zeros((2, 1, 0, 6)) if by_direction is None else _checked(by_direction)
    return Performance(
        tuple(pose_figures(poses[:, point], wanted[point]) for point in range(5)),
        distance_figures(poses[:, 1, :3], poses[:, 3, :3], float(np.linalg.norm(wanted[1, :3] - wanted[3, :3]))),
        tuple(multi_direction(varied[:, :, point]) for point in range(varied.shape[2])),
        len(poses),
    )


def pose_figures(attained: ArrayLike, command: ArrayLike) -> PoseFigures:
    """AP and RP of one point: attained poses (n, 6), command (6,).

    l_j = |m_j − m̄|, RP_l = l̄ + 3 S_l. Angles are differences from the command within ±180°.
    """
    away = _differences(_checked(attained), np.asarray(command, float))
    mean = away.mean(axis=0)
    radii = np.linalg.norm(away[:, :3] - mean[:3], axis=1)
    repeatability = float(radii.mean() + 3.0 * radii.std(ddof=1))
    angles = 3.0 * away[:, 3:].std(axis=0, ddof=1)
    return PoseFigures(float(np.linalg.norm(mean[:3])), mean[:3], mean[3:], repeatability, angles)


def distance_figures(first: ArrayLike, second: ArrayLike, commanded_mm: float) -> DistanceFigures:
    """AD and RD of the distances D_j = |P2_j − P4_j| between attained positions (n, 3) of the same cycles."""
    distances = np.linalg.norm(_checked(first) - _checked(second), axis=1)
    return DistanceFigures(float(distances.mean() - commanded_mm), float(3.0 * distances.std(ddof=1)))


def multi_direction(attained: ArrayLike) -> MultiDirection:
    """vAP of one point: poses (n, directions, 6); the largest distance between the means of any two directions."""
    poses = _checked(attained)
    away = _differences(poses, poses[0, 0])
    means = away.mean(axis=0)
    between = means[:, None] - means
    return MultiDirection(float(np.linalg.norm(between[..., :3], axis=-1).max()), np.abs(between[..., 3:]).max((0, 1)))


def cube_points(corner: ArrayLike, edge_mm: float, share: float = DIAGONAL_SHARE) -> Floats:
    """P1 … P5 (5, 3), mm, on the diagonal plane of the cube from `corner` (3,) along the frame's axes.

    One of the standard's diagonal planes: it contains the y-edge at x = z = 0 and that at x = z = 1. P1 is its centre;
    P2 … P5 lie on its two diagonals, `share` of a diagonal from its ends, P2 opposite P4 and P3 opposite P5. Raises
    ValueError for a share outside 8 … 12 %.
    """
    if not 0.08 <= share <= 0.12:
        raise ValueError(f"the points lie (10 ± 2) % of the diagonal from its ends, not {100 * share:g} %")
    corners = np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 1.0], [1.0, 0.0, 1.0]])
    middle = np.full(3, 0.5)
    inset = corners + 2.0 * share * (middle - corners)
    return np.asarray(np.asarray(corner, float) + edge_mm * np.vstack([middle, inset]))


def _differences(poses: Floats, origin: Floats) -> Floats:
    """Poses (..., 6) less `origin` (6,), the angles within ±180°."""
    away = poses - origin
    away[..., 3:] = (away[..., 3:] + 180.0) % 360.0 - 180.0
    return away


def _checked(values: ArrayLike) -> Floats:
    array = np.asarray(values, float)
    if len(array) < 2 or not np.isfinite(array).all():
        raise ValueError("ISO 9283 figures need at least two cycles and finite values: measure the missing ones again")
    return array
