"""A sphere located by touches with a fixed model, and the uncertainty of a stand-off from it.

The model was fitted without this sphere. A stand-off's error is the model's error at that posture, along the normal,
less the part that equally affected the location of the sphere.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from cellctl.calibration.estimation.estimate import estimate
from cellctl.calibration.model.robot_model import RobotModel
from cellctl.calibration.model.unknowns import State, Tolerances, Unknowns
from cellctl.calibration.rows import TouchRows
from cellctl.calibration.rows.places import sphere_centre
from cellctl.kinematics import Floats


@final
@dataclass(frozen=True, eq=False)
class LocatedSphere:
    """A sphere located by touches with `model`: only the centre was fitted.

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


def locate_sphere(model: RobotModel, q: Floats, reach: Floats, sigma_mm: float) -> LocatedSphere:
    """The sphere that `model` locates from touches at q (N, n), rad, at distances `reach` (N,), mm, from the centre.

    sigma_mm: 1 σ of a touch along the normal. Raises ValueError with fewer than four touches.
    """
    if len(q) < 4:
        raise ValueError(f"{len(q)} touches do not locate a sphere and show that they agree: four at least")
    rows = TouchRows(q, np.zeros(len(q), int), reach, np.full((len(q), 1), sigma_mm))
    start = State.alone(model, sphere_centre(model.tcp(q), reach)[None])
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
