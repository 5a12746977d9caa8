"""A pose with its covariance, and the normalised error (NEES) by which simulations check such covariances."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, final

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats
from scipy.spatial.transform import Rotation

from cellctl.kinematics import Floats, inverse_pose, pose, pose_difference


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
    low, high = stats.chi2.interval(confidence, count)
    return NeesRange(float(each.mean()), float(low) / count, float(high) / count)


def cross_matrix(vector: Floats) -> Floats:
    """[v] (..., 3, 3) of v (..., 3), so that [v] w = v × w."""
    return np.asarray(np.cross(vector[..., None, :], -np.eye(3)))
