"""Uncertainty of TCPs relative to each other, without a common rigid motion."""

from __future__ import annotations

import numpy as np

from cellctl.calibration.model.postures import At, Postures
from cellctl.calibration.model.robot_model import RobotModel
from cellctl.kinematics import Floats

POINTS = 256
"""Points over which the uncertainty in a joint region is averaged."""


def shape_sigma(model: RobotModel, covariance: Floats, at: At) -> Floats:
    """1 σ (N,), 3-D, mm, of each TCP relative to all at postures, or model angles (N, n), rad, N ≥ 4.

    covariance (P, P): of the model's parameters. Common rigid motions are left out: the place of the model's frame
    depends on the source of the joints. Three points and fewer have hardly any shape: ValueError.
    """
    shape = shape_columns(model, at)
    variance = np.sum((shape @ covariance) * shape, axis=1)
    return np.asarray(np.sqrt(np.maximum(variance.reshape(-1, 3).sum(axis=1) + 3.0 * model.open_variance(at), 0.0)))


def shape_columns(model: RobotModel, at: At) -> Floats:
    """Derivative by parameter of the relative places of the TCPs at postures, or model angles (N, n), rad, N ≥ 4.

    (3 N, P), mm per unit of each, common rigid motions removed. ValueError for fewer points.
    """
    postures = Postures.of(at)
    if len(postures) < 4:
        raise ValueError(f"{len(postures)} points have no shape to speak of")
    columns = model.jacobian(postures)[:, :3].reshape(3 * len(postures), -1)
    together, _ = np.linalg.qr(_rigid_motions(model.tcp(postures)))
    return np.asarray(columns - together @ (together.T @ columns))


def sigma_among(model: RobotModel, covariance: Floats, at: At) -> float:
    """`shape_sigma` as RMS over the rows, mm."""
    return float(np.sqrt(np.mean(shape_sigma(model, covariance, at) ** 2)))


def sigma_over_region(model: RobotModel, covariance: Floats, lower: Floats, upper: Floats) -> float:
    """`sigma_among` for points spread evenly (Sobol) over the joint region lower (n,) … upper (n,), rad; mm."""
    return sigma_among(model, covariance, spread_over(lower, upper))


def spread_over(lower: Floats, upper: Floats, points: int = POINTS) -> Floats:
    """Joint angles (points, n) spread evenly (Sobol) over lower (n,) … upper (n,); points: a power of two."""
    from scipy.stats import qmc

    return np.asarray(lower + qmc.Sobol(len(lower), scramble=False).random(points) * (upper - lower))


def _rigid_motions(points: Floats) -> Floats:
    """How points (N, 3) move under three slides and three turns about their middle (3 N, 6), per mm and per spread."""
    arms = points - points.mean(axis=0)
    arms = arms / max(float(np.abs(arms).max()), 1e-9)
    turns = [np.cross(axis, arms) for axis in np.eye(3)]
    slides = [np.broadcast_to(axis, arms.shape) for axis in np.eye(3)]
    return np.stack([motion.reshape(-1) for motion in (*slides, *turns)], axis=1)
