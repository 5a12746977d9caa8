"""Places of TCPs relative to each other, without a common rigid motion."""

from __future__ import annotations

import numpy as np

from cellctl.calibration.model.postures import At, Postures
from cellctl.calibration.model.robot_model import RobotModel
from cellctl.kinematics import Floats

POINTS = 256
"""Points over which the uncertainty in a joint region is averaged."""


def shape_columns(model: RobotModel, at: At, over: At | None = None) -> Floats:
    """Derivative by parameter of the relative places of the TCPs at postures, or model angles (N, n), rad.

    (3 N, P), mm per unit of each; the rigid motion that the TCPs at `over` (M ≥ 4, default: `at`) have in common is
    removed: three points and fewer have hardly any shape. ValueError for fewer.
    """
    postures = Postures.of(at)
    reference = postures if over is None else Postures.of(over)
    if len(reference) < 4:
        raise ValueError(f"{len(reference)} points have no shape to speak of")
    points = model.tcp(reference)
    middle = points.mean(axis=0)
    spread = max(float(np.abs(points - middle).max()), 1e-9)
    columns = _columns(model, reference)
    motion = np.linalg.lstsq(_rigid_motions((points - middle) / spread), columns, rcond=None)[0]
    if over is None:
        return np.asarray(columns - _rigid_motions((points - middle) / spread) @ motion)
    return np.asarray(_columns(model, postures) - _rigid_motions((model.tcp(postures) - middle) / spread) @ motion)


def _columns(model: RobotModel, postures: Postures) -> Floats:
    return np.asarray(model.jacobian(postures)[:, :3].reshape(3 * len(postures), -1))


def spread_over(lower: Floats, upper: Floats, points: int = POINTS) -> Floats:
    """Joint angles (points, n) spread evenly (Sobol) over lower (n,) … upper (n,); points: a power of two."""
    from scipy.stats import qmc

    return np.asarray(lower + qmc.Sobol(len(lower), scramble=False).random(points) * (upper - lower))


def _rigid_motions(arms: Floats) -> Floats:
    """How points at `arms` (N, 3) from their middle, per spread, move under three slides and turns (3 N, 6)."""
    turns = [np.cross(axis, arms) for axis in np.eye(3)]
    slides = [np.broadcast_to(axis, arms.shape) for axis in np.eye(3)]
    return np.stack([motion.reshape(-1) for motion in (*slides, *turns)], axis=1)
