"""The tool at fixed points in unknown places: touches on spheres, ball-bars, draw-wires, sockets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, final

import numpy as np

from cellctl.calibration.model.postures import At
from cellctl.calibration.model.robot_model import RobotModel
from cellctl.calibration.model.unknowns import State
from cellctl.calibration.rows.kind import RowsAtJoints, with_points
from cellctl.calibration.rows.places import sphere_centre
from cellctl.kinematics import Floats


@final
@dataclass(frozen=True, eq=False)
class TouchRows(RowsAtJoints):
    """Distances from an unknown point: touches on a sphere, a ball-bar about its socket, a draw-wire from its outlet.

    at (N): postures; point (N,): index of the point (a sphere's centre); reach (N,): measured distance, mm (for a touch
    sphere radius + tip radius); sigma (N, 1), mm, along the line between. datum (N,): index of the unknown zero of the
    row's instrument, by which the reach exceeds the distance; -1: none. None: none in any row.
    """

    at: At
    point: Any
    reach: Floats
    sigma: Floats
    session: int = 0
    datum: Any = None

    one: ClassVar[str] = "distance"
    many: ClassVar[str] = "distances"
    along_line: ClassVar[bool] = True
    noun: ClassVar[str] = "sphere"
    visits: ClassVar[str] = "touches"
    visits_at_least: ClassVar[int] = 4

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.datum is None:
            object.__setattr__(self, "datum", np.full(len(self), -1))

    @property
    def quantities(self) -> tuple[str, ...]:
        """One distance."""
        return ("distance",)

    def residual(self, state: State) -> Floats:
        """The tool's distance from the point less the measured one (N, 1), mm."""
        away = self._model(state).tcp(self.postures) - state.points[self.point]
        return np.asarray(np.linalg.norm(away, axis=-1) - self.lengths(state))[:, None]

    def jacobian(self, state: State) -> Floats:
        """(N, 1, P): the TCP's motion along the line between, less the point's; 1 for the row's datum."""
        model, normal = self._model(state), self.normals(state)
        along = np.einsum("nr,nrp->np", normal, model.jacobian(self.postures)[:, :3])[:, None]
        result = with_points(along, -normal[:, None], self.point, state, self.session)
        unsure = np.flatnonzero(self.datum >= 0)
        result[unsure, 0, state.datums_at + self.datum[unsure]] = 1.0
        return result

    def errors(self, state: State) -> Floats:
        """Difference from the measured distance (N,), mm: of a touch, the distance to the sphere's surface."""
        return np.abs(self.residual(state)[:, 0])

    @property
    def zeros(self) -> Any:
        """Each row's datum (N,)."""
        return self.datum

    def place(self, model: RobotModel) -> Floats:
        """The centre (3,), mm, of the sphere that the TCPs lie on."""
        return sphere_centre(model.tcp(self.postures), self.reach)

    def normals(self, state: State) -> Floats:
        """Unit vectors (N, 3) from each row's point to the TCP."""
        away = self._model(state).tcp(self.postures) - state.points[self.point]
        return np.asarray(away / np.maximum(np.linalg.norm(away, axis=-1, keepdims=True), 1e-9))

    def anywhere(self, state: State) -> Floats:
        """TCPs (N, 3) that touch each row's sphere from any side."""
        normals = np.random.default_rng(len(self)).normal(size=(len(self), 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return np.asarray(state.points[self.point] + self.lengths(state)[:, None] * normals)

    def lengths(self, state: State) -> Floats:
        """The measured distances (N,), mm: the readings less the datums of `state`."""
        return np.asarray(self.reach - np.append(state.datums, 0.0)[self.datum])  # -1: the last one, 0


@final
@dataclass(frozen=True, eq=False)
class SocketRows(RowsAtJoints):
    """The tool repeatedly at an unknown point: a ball held in a socket, a tip in a cone.

    at (N): postures; point (N,): index of the socket; sigma (N, 3), mm.
    """

    at: At
    point: Any
    sigma: Floats
    session: int = 0

    one: ClassVar[str] = "socket visit"
    many: ClassVar[str] = "socket visits"
    has_length: ClassVar[bool] = False
    noun: ClassVar[str] = "socket"
    visits: ClassVar[str] = "visits"
    visits_at_least: ClassVar[int] = 2

    @property
    def quantities(self) -> tuple[str, ...]:
        """Three coordinates."""
        return ("socket",) * 3

    def residual(self, state: State) -> Floats:
        """The tool's place less the socket's (N, 3), mm."""
        return np.asarray(self._model(state).tcp(self.postures) - state.points[self.point])

    def jacobian(self, state: State) -> Floats:
        """(N, 3, P)."""
        columns = self._model(state).jacobian(self.postures)[:, :3]
        turned = np.broadcast_to(-np.eye(3), (len(self), 3, 3))
        return with_points(columns, turned, self.point, state, self.session)

    def errors(self, state: State) -> Floats:
        """3-D distance (N,) from the socket, mm."""
        return np.asarray(np.linalg.norm(self.residual(state), axis=-1))
