"""Predictions of an identified model, and their σ: of TCPs in a frame, or relative to each other.

With J the Jacobian of the TCP by the parameters (3, P) and C their covariance,

    σ² = λ² (tr(J C Jᵀ) + 3 v + s² + o²)

v: variance that the residual models leave open on each axis; s: scatter of the robot that changes too fast for the
model; o: what the model may be wrong by outside the measured region. Without s and o a model of a real robot states a
third of its error (UR10: 0.026 mm where 0.087 mm are right). λ: `MeasuredRegion.model_error_scale`, 1 unless the rows
are at fixed points and show that the model lacks something.

**Relative places.** A rigid motion of all points together is no error of their shape. The six motions of the points
x_n are the columns of G (slides, and turns about the mean); J is replaced by J − G (GᵀG)⁻¹GᵀJ, its part across G. The
base of a model from touches is free up to such a motion: then C is conditioned on the gauge (`gauge_fixed`).

**Held-out rows.** The residual r (k numbers, in σ) of a row that was not fitted has the covariance S = I + J C Jᵀ + E,
E the extra variance outside the region, on the numbers that are lengths; p = P(χ²_k ≥ rᵀ S⁻¹ r). Where something of
these rows was itself fitted to them (a socket's place, a session's base) errors within the span of that fit cannot
show: with its orthonormal basis B over all these rows, I becomes I − B Bᵀ, and J becomes J − B T, T = BᵀJ what the fit
absorbed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias, final

import numpy as np

from cellctl.calibration.distributions import chi2_sf
from cellctl.calibration.model.postures import At, Postures
from cellctl.calibration.model.robot_model import RobotModel
from cellctl.calibration.model.unknowns import State
from cellctl.calibration.problem.measured_region import MeasuredRegion
from cellctl.calibration.rows import Measured
from cellctl.calibration.selection.cross_validation import squared_distances
from cellctl.kinematics import Bools, Floats
from cellctl.kinematics.low_discrepancy import spread_over

REGION_POINTS = 256
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


def _rigid_motions(arms: Floats) -> Floats:
    """How points at `arms` (N, 3) from their middle, per spread, move under three slides and turns (3 N, 6)."""
    turns = [np.cross(axis, arms) for axis in np.eye(3)]
    slides = [np.broadcast_to(axis, arms.shape) for axis in np.eye(3)]
    return np.stack([motion.reshape(-1) for motion in (*slides, *turns)], axis=1)


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
"""Postures per computation: the memory of their Jacobians stays some tens of MB."""


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
    if region is None:
        return np.asarray(np.sqrt(variance))
    return np.asarray(region.model_error_scale * np.hypot(np.sqrt(variance), region.sigma(postures.q)))


def sigma_among(model: RobotModel, covariance: Floats, at: At, region: MeasuredRegion | None = None) -> float:
    """`prediction_sigma` of the TCPs among each other, as RMS over the rows, mm."""
    return float(np.sqrt(np.mean(prediction_sigma(model, covariance, at, region, kind="among") ** 2)))


def sigma_over_region(
    model: RobotModel, covariance: Floats, lower: Floats, upper: Floats, region: MeasuredRegion | None = None
) -> float:
    """`sigma_among` for points spread evenly (Sobol) over the joint region lower (n,) … upper (n,), rad; mm."""
    return sigma_among(model, covariance, spread_over(lower, upper, REGION_POINTS, scramble=False), region)


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
        """Which rows (N,) lie within their 95 % region: the ellipsoid rᵀS⁻¹r ≤ χ²_k(0.95)."""
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
            # r has nothing along B: the small number only keeps S invertible
            spread = spread - np.matmul(own, np.swapaxes(own, -1, -2)) + 1e-9 * np.eye(residual.shape[1])
        scaled = lengths * extra[part, None] / block.sigma
        spread = spread + (scaled**2)[:, :, None] * np.eye(residual.shape[1])
        spread = spread + np.matmul(moved, np.swapaxes(lines, -1, -2))
        # the noise's part I becomes tails² I: large errors are more frequent than in a normal distribution. `variance`
        # stays without it: regions are widened, σ is not (decision 26)
        wider = spread + (tails**2 - 1.0) * np.eye(residual.shape[1])
        along = np.diagonal(spread, axis1=-2, axis2=-1) * block.sigma**2
        variance[part] = np.sum(along[:, lengths], axis=-1)
        p_value[part] = chi2_sf(squared_distances(residual, wider), residual.shape[1])
    return PredictedRows(variance, p_value)
