"""What touches tell of touched objects: planes as a fit found them, a located sphere, drift from repeats.

The model was fitted without this sphere. A stand-off's error is the model's error at that posture, along the normal,
less the part that equally affected the location of the sphere.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.calibration.distributions import t_ppf
from cellctl.calibration.model.robot_model import RobotModel
from cellctl.calibration.model.unknowns import State, Tolerances, Unknowns
from cellctl.calibration.problem.task import Task
from cellctl.calibration.rows import TouchRows
from cellctl.calibration.rows.fixed_points import by_pole, planes_of, sphere_centre
from cellctl.calibration.solver.estimate import Estimate, estimate
from cellctl.kinematics import Floats


@final
@dataclass(frozen=True, eq=False)
class PlaneEstimate:
    """The plane that is point number `point` of its task: normal (3,) · x = offset_mm, tools on the normal's side.

    sigma_mm: 1 σ of its place along the normal, in the middle of its touches; tilt_sigma_deg: 1 σ of the normal, over
    both tilts.
    """

    point: int
    normal: Floats
    offset_mm: float
    sigma_mm: float
    tilt_sigma_deg: float


def plane_estimates(task: Task, found: Estimate) -> list[PlaneEstimate]:
    """The planes of `task` where the rows `found` them, in the measuring frame."""
    return [_estimate(task, found, point) for point in sorted(task.planes)]


def _estimate(task: Task, found: Estimate, point: int) -> PlaneEstimate:
    state, pole = found.state, found.state.points[point]
    touching = [block for block in task.rows.blocks if block.of_planes]
    tcps = [state.models[block.session].tcp(block.postures)[block.visited == point] for block in touching]
    middle = np.concatenate(tcps).mean(axis=0)
    own = state.points_at + 3 * point + np.arange(3)
    covariance = found.covariance[np.ix_(own, own)]
    normal, offset = planes_of(pole)
    # height at `middle` by the pole; the normal p/|p| turns by the part of dp across it, divided by |p|
    along, level = by_pole(pole[None], middle[None])[0], np.eye(3) - np.outer(normal, normal)
    tilts = max(float(np.trace(level @ covariance @ level)), 0.0) / float(pole @ pole)
    return PlaneEstimate(
        point=point,
        normal=normal,
        offset_mm=float(offset),
        sigma_mm=float(np.sqrt(max(along @ covariance @ along, 0.0))),
        tilt_sigma_deg=float(np.rad2deg(np.sqrt(tilts))),
    )


@final
@dataclass(frozen=True, eq=False)
class LocatedSphere:
    """A sphere located by touches with `model`: only the centre was fitted.

    To first order N δc = δρ − L δθ, N (N, 3) the touches' normals: a distance moves the centre by N⁺ (`follows`), and
    the model's error δθ by −N⁺ L (`columns`). At a stand-off with normal n it shows as n·(J δθ) − n·N⁺ L δθ.

    centre (3,), mm, in the model's gauge. follows (3, N): how the centre moves with each touch's distance, mm/mm.
    columns (N, P): how each touch's distance moves with the model's parameters. residuals (N,): distances of the
    touches from the surface, mm. sigma_mm: 1 σ of one touch along the normal.
    """

    model: RobotModel
    centre: Floats
    follows: Floats
    columns: Floats
    residuals: Floats
    sigma_mm: float

    def distances(self, q: Floats) -> Floats:
        """Distance (M,), mm, of the model's TCP from the centre at model angles q (M, n), rad."""
        return np.asarray(np.linalg.norm(self.model.tcp(q) - self.centre, axis=-1))

    def normals(self, q: Floats) -> Floats:
        """Unit vectors (M, 3) from the centre to the TCP."""
        away = self.model.tcp(q) - self.centre
        return np.asarray(away / np.linalg.norm(away, axis=-1, keepdims=True))

    def sigma_of_stand_off(self, covariance: Floats, q: Floats) -> Floats:
        """1 σ (M,), mm, of the true distance to the surface about `distances`, for moves to q (M, n), rad.

        covariance (P, P): of the model's parameters. Included: model and centre with their correlation (the same model
        located the centre), the scatter of the touches that located it, and the robot's at the move itself.
        """
        normals = self.normals(q)
        through_touches = normals @ self.follows
        columns = np.einsum("mr,mrp->mp", normals, self.model.jacobian(q)[:, :3]) - through_touches @ self.columns
        of_model = np.einsum("mp,pq,mq->m", columns, covariance, columns)
        scatter = self.sigma_mm**2 * (1.0 + np.sum(through_touches**2, axis=-1))
        return np.asarray(np.sqrt(np.maximum(of_model, 0.0) + scatter))


def locate_sphere(
    model: RobotModel, q: Floats, reach: Floats, sigma_mm: float, near: Floats | None = None
) -> LocatedSphere:
    """The sphere that `model` locates from touches at q (N, n), rad, at distances `reach` (N,), mm, from the centre.

    sigma_mm: 1 σ of a touch along the normal. near (3,), mm: where the search for the centre begins; else at the
    centre that fits best, which is on the other side of a few touches where the model is far off. Raises ValueError
    with fewer than four touches.
    """
    if len(q) < 4:
        raise ValueError(f"{len(q)} touches do not locate a sphere and show that they agree: four at least")
    rows = TouchRows(q, np.zeros(len(q), int), reach, np.full((len(q), 1), sigma_mm))
    begin = sphere_centre(model.tcp(q), reach) if near is None else near
    start = State.alone(model, begin[None])
    unknowns = Unknowns.of(start, ("sphere",), Tolerances())
    found = estimate(unknowns.only(frozenset({"points"})), [rows]).state
    columns = rows.jacobian(found)[:, 0]
    normals = -columns[:, -3:]
    return LocatedSphere(
        model=model,
        centre=found.points[0],
        follows=np.asarray(np.linalg.pinv(normals)),
        columns=columns[:, :-3],
        residuals=rows.residual(found)[:, 0],
        sigma_mm=sigma_mm,
    )


SIGNIFICANT = 0.01
"""Significance level: scatter alone is taken for drift in one campaign in a hundred."""

KNOWN_FROM = 30
"""Cycles from which a robot's repeatability counts as known (ISO 9283 requires 30): the weight of the stated σ
in degrees of freedom."""


@final
@dataclass(frozen=True, slots=True)
class Drift:
    """A straight line through the visits to one touch.

    mm_per_touch: change of the shift along the normal with each touch, with its 1 σ; t: their ratio; significant:
    whether it exceeds scatter; visits: their count, with the first.
    """

    mm_per_touch: float
    sigma: float
    t: float
    significant: bool
    visits: int

    def at(self, touch: ArrayLike) -> Floats:
        """Shift (N,), mm, at touch numbers (N,) against touch 0."""
        return np.asarray(np.asarray(touch, float) * self.mm_per_touch)


def linear_drift(touch: ArrayLike, shift_mm: ArrayLike, sigma_mm: float) -> Drift:
    """The drift through visits at touch numbers (V,) with shifts (V,), mm, each with 1 σ `sigma_mm`.

    t test of the slope. Its scatter is pooled from the prior `sigma_mm`, with `KNOWN_FROM` cycles, and the visits about
    the line, with V − 2: s² = (30 σ² + Σ r²)/(30 + V − 2), the slope has the variance s²/Σ(t − t̄)². Of a few visits
    alone s² is a poor estimate. Fewer than three visits show no drift. The line has an intercept: the first visit, from
    which all shifts are counted, has scatter too.
    """
    number, shift = np.asarray(touch, float), np.asarray(shift_mm, float)
    visits = int(number.size)
    if visits < 3 or np.ptp(number) == 0.0:
        return Drift(0.0, 0.0, 0.0, False, visits)
    away = number - number.mean()
    spread = float(away @ away)
    slope = float(away @ shift) / spread
    residual = shift - shift.mean() - slope * away
    freedom = KNOWN_FROM + visits - 2
    scatter = float(np.sqrt((KNOWN_FROM * sigma_mm**2 + residual @ residual) / freedom))
    sigma = scatter / spread**0.5
    ratio = slope / sigma
    significant = abs(ratio) > float(t_ppf(1.0 - SIGNIFICANT / 2.0, freedom))
    return Drift(slope, sigma, ratio, bool(significant), visits)
