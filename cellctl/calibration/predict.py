"""What an identified model says, and how sure it is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import chi2

from cellctl.calibration.estimate import Estimate
from cellctl.calibration.model import RobotModel
from cellctl.calibration.rows import Rows
from cellctl.kinematics import Bools, Floats

BLOCK = 4096


@final
@dataclass(frozen=True, eq=False)
class Prediction:
    """Predicted tool poses (N, 4, 4), mm, and 1 σ of the point, 3-D (root of the summed variances), mm (N,)."""

    poses: Floats
    sigma_mm: Floats


def predict(model: RobotModel, covariance: Floats, q: ArrayLike) -> Prediction:
    """Tool poses at model angles q (N, n), rad, with the uncertainty that `covariance` (P, P) of the parameters leaves.

    The σ is the model's: neither the robot's repeatability nor what the model leaves out is in it.
    """
    angles = np.asarray(q, float).reshape(-1, model.n)
    variance = np.empty(len(angles))
    for start in range(0, len(angles), BLOCK):
        part = np.s_[start : start + BLOCK]
        columns = model.jacobian(angles[part])[:, :3]
        variance[part] = np.einsum("nkp,nkp->n", np.matmul(columns, covariance), columns)
    return Prediction(model.pose(angles), np.sqrt(np.maximum(variance, 0.0)))


@final
@dataclass(frozen=True, eq=False)
class Foreseen:
    """Held-out rows as foreseen: variance (N,) of each distance error, mm²; chance (N,): of an error as improbable as
    the one found, or more so.
    """

    variance: Floats
    chance: Floats

    @property
    def inside(self) -> Bools:
        """Which rows (N,) lie within their 95 % region."""
        return np.asarray(self.chance >= 0.05)


def foresee(found: Estimate, rows: Rows) -> Foreseen:
    """Whether rows that the fit never saw fall where its covariance and their own noise put them."""
    residual, columns = rows.residual(found.state), rows.jacobian(found.state)
    spread = np.matmul(np.matmul(columns, found.covariance), np.swapaxes(columns, -1, -2))
    spread = spread + rows.sigma[:, :, None] * np.eye(rows.sigma.shape[1]) * rows.sigma[:, None, :]
    squared = np.einsum("nk,nk->n", residual, np.linalg.solve(spread, residual[..., None])[..., 0])
    lengths = np.array([quantity != "rotation" for quantity in rows.quantities])
    variance = np.sum(np.diagonal(spread, axis1=-2, axis2=-1)[:, lengths], axis=-1)
    return Foreseen(np.asarray(variance), np.asarray(chi2.sf(squared, rows.sigma.shape[1]), float))
