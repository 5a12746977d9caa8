"""A pose with its covariance (NEES checks it), from matched points by a rigid transform; gravity in the base."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, final

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from cellctl.calibration.distributions import chi2_ppf, chi2_sf
from cellctl.calibration.problem.registration import rigid_fit
from cellctl.kinematics import Floats, inverse_pose, pose, pose_difference
from cellctl.metrology.measured_points import whitened


@final
@dataclass(frozen=True, eq=False)
class MeasuredPose:
    """A frame in another: matrix (4, 4), mm; covariance (6, 6) of a small slide (mm) and a small turn (rad).

    Both are along the outer frame's axes, the turn about the pose's own origin: p + δp, exp([δω]) R. These are the
    residuals of pose rows (`PoseRows`).
    """

    matrix: Floats
    covariance: Floats

    @property
    def sigma(self) -> Floats:
        """Standard deviations (6,): three mm, three rad."""
        return np.sqrt(np.diag(self.covariance))

    def inverse(self) -> MeasuredPose:
        """The outer frame in this one: δω' = −Rᵀ δω, δp' = −Rᵀ (δp + p × δω)."""
        turn, place = self.matrix[:3, :3], self.matrix[:3, 3]
        change = np.zeros((6, 6))
        change[:3, :3] = change[3:, 3:] = -turn.T
        change[:3, 3:] = -turn.T @ cross_matrix(place)
        return MeasuredPose(inverse_pose(self.matrix), change @ self.covariance @ change.T)

    def within(self, outer: ArrayLike) -> MeasuredPose:
        """This pose as seen from a frame in which its own outer frame is at `outer` (4, 4), known exactly."""
        frame = np.asarray(outer, float)
        change = np.kron(np.eye(2), frame[:3, :3])
        return MeasuredPose(frame @ self.matrix, change @ self.covariance @ change.T)

    def nees(self, true: ArrayLike) -> float:
        """eᵀ C⁻¹ e / 6 of its error from the pose `true` (4, 4); 1 on average if the covariance is right."""
        return nees(pose_difference(self.matrix, np.asarray(true, float)), self.covariance)


def moved_by(matrix: Floats, change: Floats) -> Floats:
    """The pose (4, 4) after a small `change` (6,) as in `MeasuredPose`."""
    turn = Rotation.from_rotvec(change[3:]).as_matrix()
    return pose(turn @ matrix[:3, :3], matrix[:3, 3] + change[:3])


def nees(error: Floats, covariance: Floats) -> float:
    """Normalised error squared eᵀ C⁻¹ e / k of an error (k,) with covariance (k, k)."""
    return float(error @ np.linalg.solve(covariance, error) / len(error))


class NeesRange(NamedTuple):
    """Mean NEES of repeated runs, and the limits that it keeps with the stated confidence if covariances are right."""

    mean: float
    low: float
    high: float

    @property
    def consistent(self) -> bool:
        """Whether the mean is between the limits."""
        return self.low <= self.mean <= self.high


def nees_range(values: ArrayLike, size: int, confidence: float = 0.99) -> NeesRange:
    """Mean of NEES `values` (K,) of errors with `size` components; limits χ²(K·size) / (K·size)."""
    each = np.asarray(values, float)
    count = each.size * size
    low, high = chi2_ppf([0.5 - confidence / 2.0, 0.5 + confidence / 2.0], count)
    return NeesRange(float(each.mean()), float(low) / count, float(high) / count)


def cross_matrix(vector: Floats) -> Floats:
    """[v] (..., 3, 3) of v (..., 3), so that [v] w = v × w."""
    return np.asarray(np.cross(vector[..., None, :], -np.eye(3)))


STEPS = 20
"""Of Gauss–Newton at the most."""


@final
@dataclass(frozen=True, eq=False)
class RigidFit:
    """pose: carries the points to the measured ones. residual (N, 3), mm: carried less measured. chi2, dof: of it."""

    pose: MeasuredPose
    residual: Floats
    chi2: float
    dof: int

    @property
    def p_value(self) -> float:
        """Probability of residuals at least this large if the covariances are right; 1 without redundancy."""
        return float(chi2_sf(self.chi2, self.dof)) if self.dof > 0 else 1.0


def rigid_transform(points: Floats, measured: Floats, covariance: Floats) -> RigidFit:
    """Carry `points` (N, 3) to `measured` (N, 3), mm, by generalised least squares.

    covariance (3N, 3N), mm²: of the differences, in the measured points' frame. Start by Kabsch's closed form; then
    Gauss–Newton with δm = δp + δω × (R x). Raises ValueError for fewer than three points or points on a line.
    """
    if len(points) < 3 or np.linalg.svd(points - points.mean(axis=0))[1][1] < 1e-3:
        raise ValueError("a rigid transform needs three points that are not on a line")
    matrix = rigid_fit(points, measured)
    for _ in range(STEPS):
        jacobian, residual = _rows(matrix, points, measured)
        rows, white = whitened(covariance, jacobian, residual)
        step = np.asarray(np.linalg.lstsq(rows, -white, rcond=None)[0], float)
        matrix = moved_by(matrix, step)
        if np.abs(step[:3]).max() < 1e-9 and np.abs(step[3:]).max() < 1e-12:
            break
    jacobian, residual = _rows(matrix, points, measured)
    rows, white = whitened(covariance, jacobian, residual)
    pose = MeasuredPose(matrix, np.asarray(np.linalg.inv(rows.T @ rows)))
    return RigidFit(pose, residual.reshape(-1, 3), float(white @ white), residual.size - 6)


def _rows(matrix: Floats, points: Floats, measured: Floats) -> tuple[Floats, Floats]:
    """Jacobian (3N, 6) by slide and turn, and residual (3N,)."""
    arms = points @ matrix[:3, :3].T
    jacobian = np.zeros((len(points), 3, 6))
    jacobian[:, :, :3] = np.eye(3)
    jacobian[:, :, 3:] = -cross_matrix(arms)
    return jacobian.reshape(-1, 6), (arms + matrix[:3, 3] - measured).ravel()


@final
@dataclass(frozen=True, eq=False)
class Gravity:
    """direction (3,): unit vector of gravity in the robot's base frame. covariance (3, 3): of rank 2, rad².

    tilt_rad: angle between gravity and the base's −z. sigma_tilt_rad: its standard deviation.
    """

    direction: Floats
    covariance: Floats
    tilt_rad: float
    sigma_tilt_rad: float


def gravity_in_base(station: MeasuredPose, level_sigma_rad: float) -> Gravity:
    """Gravity from the instrument's frame in the base, its z opposite to gravity within `level_sigma_rad` (each axis).

    g = −R z; its covariance [g] (C_ω + σ² (1 − g gᵀ)) [g]ᵀ has the registration's turn and the compensator's error. The
    instrument must be levelled with its compensator on; a registration from axes or points says nothing of gravity.
    """
    down = -station.matrix[:3, 2]
    turns = station.covariance[3:, 3:] + level_sigma_rad**2 * (np.eye(3) - np.outer(down, down))
    change = cross_matrix(down)
    covariance = change @ turns @ change.T
    flat = np.hypot(down[0], down[1])
    heading = down[:2] / flat if flat > 0.0 else np.array([1.0, 0.0])
    along = np.append(-down[2] * heading, flat)  # how gravity's direction moves as the tilt grows
    sigma = np.sqrt(float(along @ covariance @ along))
    return Gravity(down, covariance, float(np.arctan2(flat, -down[2])), float(sigma))
