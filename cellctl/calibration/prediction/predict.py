"""Predictions of an identified model, with their uncertainty."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from scipy.stats import chi2

from cellctl.calibration.estimation.linear import squared_distances
from cellctl.calibration.model.postures import At, Postures
from cellctl.calibration.model.robot_model import RobotModel
from cellctl.calibration.model.unknowns import State
from cellctl.calibration.prediction.sigma import BLOCK, prediction_sigma
from cellctl.calibration.rows import Measured
from cellctl.kinematics import Bools, Floats


@final
@dataclass(frozen=True, eq=False)
class Prediction:
    """Predicted tool poses (N, 4, 4), mm, and 1 σ of the point, 3-D (root of the summed variances), mm (N,)."""

    poses: Floats
    sigma_mm: Floats


def predict(model: RobotModel, covariance: Floats, at: At) -> Prediction:
    """Tool poses at postures, or model angles (N, n), rad, with the uncertainty that `covariance` (P, P) of the
    parameters leaves in the base frame.

    The variance left open by the model's residual models is included. The robot's repeatability and unmodelled errors
    are not: `prediction_sigma` with a measured region has them.
    """
    return Prediction(model.pose(Postures.of(at)), prediction_sigma(model, covariance, at))


@final
@dataclass(frozen=True, eq=False)
class PredictedRows:
    """Held-out rows as predicted: variance (N,) of each distance error, mm²; p_value (N,): of an error at least as
    improbable as the one found.
    """

    variance: Floats
    p_value: Floats

    @property
    def inside(self) -> Bools:
        """Which rows (N,) lie within their 95 % region."""
        return np.asarray(self.p_value >= 0.05)


def predict_rows(
    found: State,
    covariance: Floats,
    rows: Measured,
    *,
    hidden: Floats | None = None,
    taken: Floats | None = None,
    extra_sigma: Floats | float = 0.0,
    tails: float = 1.0,
) -> PredictedRows:
    """Whether held-out rows agree with the prediction of covariance (P, P) and their own noise.

    hidden (N, k, H): basis, orthonormal over all rows given, in their standard deviations, of what was fitted to these
    rows (a socket's place, a new session's base): errors along it cannot show. taken (H, P): what that fit absorbed of
    each parameter, over all rows: this cannot show either. extra_sigma (N,): 1 σ of each row, mm, on each axis, besides
    the model's: for postures outside the measured region. tails: factor on the noise for the p-value of an error, where
    large errors are more frequent than in a normal distribution.
    """
    variance, p_value = np.empty(len(rows)), np.empty(len(rows))
    extra = np.hypot(extra_sigma, np.sqrt(found.model.open_variance(rows.postures)))
    lengths = rows.of_length
    for start in range(0, len(rows), BLOCK):
        part = np.s_[start : start + BLOCK]
        block = rows.pick(part)
        residual = block.residual(found) / block.sigma
        lines = block.jacobian(found) / block.sigma[..., None]
        if hidden is not None and taken is not None:
            lines = lines - np.matmul(hidden[part], taken)
        moved = (lines.reshape(-1, len(covariance)) @ covariance).reshape(lines.shape)
        spread = np.eye(residual.shape[1]) + np.zeros((len(block), 1, 1))
        if hidden is not None:
            own = hidden[part]
            spread = spread - np.matmul(own, np.swapaxes(own, -1, -2)) + 1e-9 * np.eye(residual.shape[1])
        scaled = lengths * extra[part, None] / block.sigma
        spread = spread + (scaled**2)[:, :, None] * np.eye(residual.shape[1])
        spread = spread + np.matmul(moved, np.swapaxes(lines, -1, -2))
        wider = spread + (tails**2 - 1.0) * np.eye(residual.shape[1])
        along = np.diagonal(spread, axis1=-2, axis2=-1) * block.sigma**2
        variance[part] = np.sum(along[:, lengths], axis=-1)
        p_value[part] = chi2.sf(squared_distances(residual, wider), residual.shape[1])
    return PredictedRows(variance, p_value)
