"""σ of a predicted TCP: the one function behind every σ of a prediction that is printed, stored or shown.

With J the Jacobian of the TCP by the parameters (3, P) and C their covariance,

    σ² = tr(J C Jᵀ) + 3 v + s² + o²

v: variance that the residual models leave open on each axis; s: scatter of the robot that changes too fast for the
model; o: what the model may be wrong by outside the measured region. Without s and o a model of a real robot states a
third of its error (UR10: 0.026 mm where 0.087 mm are right).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, TypeAlias

import numpy as np

from cellctl.calibration.model.postures import At, Postures
from cellctl.calibration.model.robot_model import RobotModel
from cellctl.calibration.prediction.measured_region import MeasuredRegion
from cellctl.calibration.prediction.shape import shape_columns, spread_over
from cellctl.kinematics import Floats

Frame: TypeAlias = Literal["base", "points"]
"""The frame in which a TCP is uncertain: `base`, the robot's base as an instrument would see it; `points`, the spheres,
sockets and planes that were touched. The same for a model whose base an instrument measured.
"""

Kind: TypeAlias = Literal["absolute", "among"]
"""`absolute`: the place of a TCP in its frame. `among`: relative to other TCPs, without common rigid motions."""

GAUGE = ("theta1", "d1")
"""Heading and height of the base: a turn about the first axis, or a slide along it, moves the robot and all touched
points equally."""

BLOCK = 4096


def prediction_sigma(
    model: RobotModel,
    covariance: Floats,
    at: At,
    region: MeasuredRegion | None = None,
    *,
    frame: Frame = "base",
    kind: Kind = "absolute",
    over: At | None = None,
) -> Floats:
    """1 σ (N,), 3-D (root of the summed variances), mm, of the TCP predicted at postures, or model angles (N, n), rad.

    covariance (P, P): of the model's parameters. region: adds scatter and the doubt outside the measured joints; None:
    the parameters' and the residual models' part alone. frame: counts for `absolute`. over: of `among`, the postures
    (M ≥ 4) whose common rigid motion is left out; default: `at` itself. ValueError for fewer.
    """
    postures = Postures.of(at)
    if kind == "among":
        shape = shape_columns(model, postures, over)
        variance = np.sum((shape @ covariance) * shape, axis=1).reshape(-1, 3).sum(axis=1)
    else:
        known = covariance if frame == "base" else gauge_fixed(covariance, model.names)
        variance = _variance(model, known, postures)
    variance = np.maximum(variance + 3.0 * model.open_variance(postures), 0.0)
    return np.asarray(np.sqrt(variance) if region is None else np.hypot(np.sqrt(variance), region.sigma(postures.q)))


def sigma_among(model: RobotModel, covariance: Floats, at: At, region: MeasuredRegion | None = None) -> float:
    """`prediction_sigma` of the TCPs among each other, as RMS over the rows, mm."""
    return float(np.sqrt(np.mean(prediction_sigma(model, covariance, at, region, kind="among") ** 2)))


def sigma_over_region(
    model: RobotModel, covariance: Floats, lower: Floats, upper: Floats, region: MeasuredRegion | None = None
) -> float:
    """`sigma_among` for points spread evenly (Sobol) over the joint region lower (n,) … upper (n,), rad; mm."""
    return sigma_among(model, covariance, spread_over(lower, upper), region)


def gauge_fixed(covariance: Floats, names: Sequence[str]) -> Floats:
    """The covariance (P, P) of parameters `names` (P,), given the estimated θ1 and d1.

    These two are unobservable in touches: the centres move with them. The place of a TCP *relative to these centres* is
    therefore as precise as if they were known, Σ_aa − Σ_ab Σ_bb⁻¹ Σ_ba; its place in a base measured by other means is
    not. Zero for parameters that were held.
    """
    chosen = [index for index, name in enumerate(names) if name in GAUGE and covariance[index, index] > 0.0]
    if not chosen:
        return covariance
    columns = covariance[:, chosen]
    return np.asarray(covariance - columns @ np.linalg.solve(covariance[np.ix_(chosen, chosen)], columns.T))


def _variance(model: RobotModel, covariance: Floats, postures: Postures) -> Floats:
    """tr(J C Jᵀ) (N,), mm²."""
    variance = np.zeros(len(postures))
    for start in range(0, len(postures), BLOCK):
        part = np.s_[start : start + BLOCK]
        columns = model.jacobian(postures.pick(part))[:, :3]
        moved = (columns.reshape(-1, len(covariance)) @ covariance).reshape(columns.shape)
        variance[part] = np.einsum("nkp,nkp->n", moved, columns)
    return variance
