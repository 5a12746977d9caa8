"""Touches on planes in unknown places, and the three parameters of such a plane.

A normal n and an offset d (the plane: n·x = d) are four numbers for three unknowns. `State.points` holds the *pole* of
each plane, p = ρ s n with s = 1000 mm and ρ = x + √(x² + 1), x = d/s, so that n = p/|p| and d = s (ρ − 1/ρ)/2. Every
plane with a side has one pole and every pole except 0 has one plane; a plane through the origin is no special case.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, final

import numpy as np

from cellctl.calibration.model.postures import At
from cellctl.calibration.model.robot_model import RobotModel
from cellctl.calibration.model.unknowns import State
from cellctl.calibration.rows.kind import RowsAtJoints, with_points
from cellctl.kinematics import Floats

SCALE_MM = 1000.0
"""About how far planes are from the frame's origin: there, 1 mm of the pole is 1 mm of offset, or 1 mrad of tilt."""

ACROSS_MM = 300.0
"""Largest shift of a touch on a plane along each axis (`anywhere`)."""

CARRIED_MM = 30.0
"""A part of the robot further from the TCP than this shows the side of the touch."""


@final
@dataclass(frozen=True, eq=False)
class PlaneRows(RowsAtJoints):
    """Touches on unknown planes by a ball.

    at (N): postures; point (N,): index of the plane; reach (N,): radius of the ball, mm, by which its centre is off the
    plane on the side that the normal points to; sigma (N, 1), mm, along the normal.
    """

    at: At
    point: Any
    reach: Floats
    sigma: Floats
    session: int = 0

    one: ClassVar[str] = "plane touch"
    many: ClassVar[str] = "plane touches"
    of_planes: ClassVar[bool] = True
    has_length: ClassVar[bool] = False
    along_line: ClassVar[bool] = True
    noun: ClassVar[str] = "plane"
    visits: ClassVar[str] = "touches"
    visits_at_least: ClassVar[int] = 4

    @property
    def quantities(self) -> tuple[str, ...]:
        """One distance from a plane."""
        return ("plane",)

    def residual(self, state: State) -> Floats:
        """The tool's distance from the plane less the ball's radius (N, 1), mm."""
        normal, offset = planes_of(state.points[self.point])
        along = np.sum(normal * self._model(state).tcp(self.postures), axis=-1)
        return np.asarray(along - offset - self.reach)[:, None]

    def jacobian(self, state: State) -> Floats:
        """(N, 1, P): the TCP's motion along the normal; of the pole, the tilt's arm at the TCP less the offset."""
        model, normal = self._model(state), self.normals(state)
        columns = np.einsum("nr,nrp->np", normal, model.jacobian(self.postures)[:, :3])[:, None]
        of_pole = by_pole(state.points[self.point], model.tcp(self.postures))
        return with_points(columns, of_pole[:, None], self.point, state, self.session)

    def errors(self, state: State) -> Floats:
        """Distance (N,) of the ball's surface from the plane, mm."""
        return np.abs(self.residual(state)[:, 0])

    def normals(self, state: State) -> Floats:
        """Each row's unit normal (N, 3), on the side that is touched."""
        return planes_of(state.points[self.point])[0]

    def place(self, model: RobotModel) -> Floats:
        """The pole (3,), mm, of the plane that the TCPs lie on."""
        tcps = model.tcp(self.postures)
        return plane_pole(tcps, self.reach, model.chain.frames(self.q)[..., :3, 3])

    def anywhere(self, state: State) -> Floats:
        """TCPs (N, 3) that touch each row's plane, up to `ACROSS_MM` from their places."""
        tcps, normal = self._model(state).tcp(self.postures), self.normals(state)
        beside = np.random.default_rng(len(self)).uniform(-ACROSS_MM, ACROSS_MM, tcps.shape)
        lift = np.sum(normal * beside, axis=1) + self.residual(state)[:, 0]
        return np.asarray(tcps + beside - lift[:, None] * normal)


def planes_of(poles: Floats) -> tuple[Floats, Floats]:
    """Unit normals (N, 3) and offsets (N,), mm, of the planes with these poles (N, 3), mm; n·x = d on the plane."""
    length = np.maximum(np.linalg.norm(poles, axis=-1), 1e-9)
    offset = 0.5 * (length - SCALE_MM**2 / length)
    return np.asarray(poles / length[..., None]), np.asarray(offset)


def pole_of(normal: Floats, offset: float) -> Floats:
    """The pole (3,), mm, of the plane with the unit `normal` (3,) at the `offset`, mm."""
    return np.asarray(SCALE_MM * np.exp(np.arcsinh(offset / SCALE_MM)) * normal)


def by_pole(poles: Floats, points: Floats) -> Floats:
    """Derivative (N, 3) by the pole of the height of `points` (N, 3), mm, above the planes with `poles` (N, 3), mm."""
    length = np.maximum(np.linalg.norm(poles, axis=-1, keepdims=True), 1e-9)
    normal = poles / length
    across = points - np.sum(normal * points, axis=-1, keepdims=True) * normal
    return np.asarray(across / length - 0.5 * (1.0 + (SCALE_MM / length) ** 2) * normal)


def plane_pole(tcps: Floats, reach: Floats, frames: Floats) -> Floats:
    """Pole (3,), mm, of the plane at distances `reach` (N,), mm, from `tcps` (N, 3), mm: across the direction of least
    spread, its normal towards the part that carries the TCPs: the last of the robot's `frames` (N, K, 3), mm, that is
    not at the TCP.
    """
    away, arms = tcps - tcps.mean(axis=0), frames - tcps[:, None]
    carrying = np.flatnonzero(np.linalg.norm(arms, axis=-1).mean(axis=0) > CARRIED_MM)
    normal = np.linalg.eigh(away.T @ away)[1][:, 0]
    if carrying.size and arms[:, carrying[-1]].mean(axis=0) @ normal < 0.0:
        normal = -normal
    return pole_of(normal, float(np.median(tcps @ normal - reach)))
