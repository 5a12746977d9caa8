"""The rigid transform between two sets of the same points, with its covariance and a χ² test of the fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from scipy import stats

from cellctl.calibration.estimation.registration import rigid_fit
from cellctl.kinematics import Floats
from cellctl.metrology.measured_pose import MeasuredPose, cross_matrix, moved_by
from cellctl.metrology.points import whitened

STEPS = 20


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
        return float(stats.chi2.sf(self.chi2, self.dof)) if self.dof > 0 else 1.0


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
