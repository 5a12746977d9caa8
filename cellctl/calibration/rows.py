"""Kinds of measurement, each a block of rows: how far the model is from them, and how that changes.

A block is of one kind and of one session; several of them make a `Mixture`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Protocol, Self, TypeAlias, final

import numpy as np

from cellctl.calibration.model import RobotModel
from cellctl.calibration.postures import At, Postures
from cellctl.calibration.unknowns import State
from cellctl.kinematics import Floats, rotation_vector


class Rows(Protocol):
    """N measurements of k numbers each, with independent errors."""

    @property
    def sigma(self) -> Floats:
        """Standard deviations (N, k), mm or rad."""
        ...

    @property
    def quantities(self) -> tuple[str, ...]:
        """What each of the k numbers is: `position`, `rotation`, …; noise is judged for each kind by itself."""
        ...

    def residual(self, state: State) -> Floats:
        """Model minus measurement (N, k), mm or rad."""
        ...

    def jacobian(self, state: State) -> Floats:
        """Derivative of `residual` (N, k, P) by all parameters, in the order of `Unknowns`."""
        ...

    def errors(self, state: State) -> Floats:
        """Distance (N,) between model and measurement as people speak of it, mm."""
        ...

    def pick(self, which: Any) -> Self:
        """The rows at an index array or mask."""
        ...

    def noisier(self, factors: Floats) -> Self:
        """The same rows with each of the k standard deviations times `factors` (k,)."""
        ...

    def __len__(self) -> int: ...


class _RowsAtJoints:
    """What the kinds measured at joint angles have in common."""

    at: At
    sigma: Floats
    session: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "at", Postures.of(self.at))

    @property
    def postures(self) -> Postures:
        """Where the robot stood, N rows."""
        return Postures.of(self.at)

    @property
    def q(self) -> Floats:
        """Model angles (N, n), rad."""
        return self.postures.q

    def __len__(self) -> int:
        return len(self.sigma)

    def noisier(self, factors: Floats) -> Self:
        """The same rows with each of the k standard deviations times `factors` (k,)."""
        return replace(self, sigma=self.sigma * factors)  # type: ignore[type-var]  # every kind is a dataclass

    def _model(self, state: State) -> RobotModel:
        return state.models[self.session]


@final
@dataclass(frozen=True, eq=False)
class PositionRows(_RowsAtJoints):
    """Tool centre points in the measuring frame. at (N): postures; xyz (N, 3) and sigma (N, 3), mm."""

    at: At
    xyz: Floats
    sigma: Floats
    session: int = 0

    @property
    def quantities(self) -> tuple[str, ...]:
        """Three coordinates."""
        return ("position",) * 3

    def residual(self, state: State) -> Floats:
        """Model point minus measured point (N, 3), mm."""
        return np.asarray(self._model(state).tip(self.postures) - self.xyz)

    def jacobian(self, state: State) -> Floats:
        """(N, 3, P)."""
        return state.spread(self._model(state).jacobian(self.postures)[:, :3], self.session)

    def errors(self, state: State) -> Floats:
        """3-D distance (N,), mm."""
        return np.asarray(np.linalg.norm(self.residual(state), axis=-1))

    def pick(self, which: Any) -> Self:
        """The rows at an index array or mask."""
        return replace(self, at=self.postures.pick(which), xyz=self.xyz[which], sigma=self.sigma[which])


@final
@dataclass(frozen=True, eq=False)
class PoseRows(_RowsAtJoints):
    """Tool poses in the measuring frame. at (N): postures; poses (N, 4, 4), mm; sigma (N, 6): three mm, three rad."""

    at: At
    poses: Floats
    sigma: Floats
    session: int = 0

    @property
    def quantities(self) -> tuple[str, ...]:
        """Three coordinates, three small turns."""
        return ("position",) * 3 + ("rotation",) * 3

    @property
    def xyz(self) -> Floats:
        """The measured positions (N, 3), mm."""
        return np.asarray(self.poses[:, :3, 3])

    def residual(self, state: State) -> Floats:
        """Model minus measured position, and the turn from measured to model, in the measuring frame (N, 6)."""
        pose = self._model(state).pose(self.postures)
        turn = np.matmul(pose[:, :3, :3], np.swapaxes(self.poses[:, :3, :3], -1, -2))
        return np.concatenate([pose[:, :3, 3] - self.poses[:, :3, 3], rotation_vector(turn)], axis=-1)

    def jacobian(self, state: State) -> Floats:
        """(N, 6, P). The turn's derivative is J_l⁻¹(φ) ω: exact for a residual turn φ of any size below π."""
        columns = self._model(state).jacobian(self.postures)
        turned = np.matmul(_left_jacobian_inverse(self.residual(state)[:, 3:]), columns[:, 3:])
        return state.spread(np.concatenate([columns[:, :3], turned], axis=1), self.session)

    def errors(self, state: State) -> Floats:
        """3-D distance of the positions (N,), mm."""
        return np.asarray(np.linalg.norm(self.residual(state)[:, :3], axis=-1))

    def pick(self, which: Any) -> Self:
        """The rows at an index array or mask."""
        return replace(self, at=self.postures.pick(which), poses=self.poses[which], sigma=self.sigma[which])


@final
@dataclass(frozen=True, eq=False)
class TouchRows(_RowsAtJoints):
    """Distances from an unknown point: touches on a sphere, a ball-bar about its socket, a draw-wire from its outlet.

    at (N): postures; point (N,): index of the point (a sphere's centre); reach (N,): measured distance, mm (for a touch
    sphere radius + tip radius); sigma (N, 1), mm, along the line between. datum (N,): index of what the reach is longer
    by than the distance, as its instrument's zero is not known; -1: nothing. None: nothing in any row.
    """

    at: At
    point: Any
    reach: Floats
    sigma: Floats
    session: int = 0
    datum: Any = None

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
        away = self._model(state).tip(self.postures) - state.points[self.point]
        return np.asarray(np.linalg.norm(away, axis=-1) - self.lengths(state))[:, None]

    def jacobian(self, state: State) -> Floats:
        """(N, 1, P): the tip's motion along the line between, less the point's; 1 for the row's datum."""
        model = self._model(state)
        away = model.tip(self.postures) - state.points[self.point]
        normal = away / np.maximum(np.linalg.norm(away, axis=-1, keepdims=True), 1e-9)
        along = np.einsum("nr,nrp->np", normal, model.jacobian(self.postures)[:, :3])[:, None]
        result = _with_points(along, -normal[:, None], self.point, state, self.session)
        unsure = np.flatnonzero(self.datum >= 0)
        result[unsure, 0, state.datums_at + self.datum[unsure]] = 1.0
        return result

    def errors(self, state: State) -> Floats:
        """Difference from the measured distance (N,), mm: of a touch, the distance to the sphere's surface."""
        return np.abs(self.residual(state)[:, 0])

    def pick(self, which: Any) -> Self:
        """The rows at an index array or mask."""
        parts = {name: getattr(self, name)[which] for name in ("point", "reach", "sigma", "datum")}
        return replace(self, at=self.postures.pick(which), **parts)

    def lengths(self, state: State) -> Floats:
        """The distances (N,) that were measured, mm: what was shown less the datums that `state` has."""
        return np.asarray(self.reach - np.append(state.datums, 0.0)[self.datum])  # -1: the last one, nothing


@final
@dataclass(frozen=True, eq=False)
class SocketRows(_RowsAtJoints):
    """The tool at an unknown point, again and again: a ball held in a socket, a tip in a cone.

    at (N): postures; point (N,): index of the socket; sigma (N, 3), mm.
    """

    at: At
    point: Any
    sigma: Floats
    session: int = 0

    @property
    def quantities(self) -> tuple[str, ...]:
        """Three coordinates."""
        return ("socket",) * 3

    def residual(self, state: State) -> Floats:
        """The tool's place less the socket's (N, 3), mm."""
        return np.asarray(self._model(state).tip(self.postures) - state.points[self.point])

    def jacobian(self, state: State) -> Floats:
        """(N, 3, P)."""
        columns = self._model(state).jacobian(self.postures)[:, :3]
        turned = np.broadcast_to(-np.eye(3), (len(self), 3, 3))
        return _with_points(columns, turned, self.point, state, self.session)

    def errors(self, state: State) -> Floats:
        """3-D distance (N,) from the socket, mm."""
        return np.asarray(np.linalg.norm(self.residual(state), axis=-1))

    def pick(self, which: Any) -> Self:
        """The rows at an index array or mask."""
        return replace(self, at=self.postures.pick(which), point=self.point[which], sigma=self.sigma[which])


Measured: TypeAlias = PositionRows | PoseRows | TouchRows | SocketRows
"""What is measured at a robot's joints."""


@final
@dataclass(frozen=True, eq=False)
class SpacingRows:
    """Certified distances between points: spheres of a plate, sockets. pairs (N, 2): indices of points; mm (N,);
    sigma (N, 1), mm.
    """

    pairs: Any
    mm: Floats
    sigma: Floats

    def __len__(self) -> int:
        return len(self.sigma)

    @property
    def quantities(self) -> tuple[str, ...]:
        """One distance, whose σ is the certificate's."""
        return ("certified",)

    def residual(self, state: State) -> Floats:
        """Distance of the points minus the certified one (N, 1), mm."""
        return np.asarray(np.linalg.norm(self._between(state), axis=-1) - self.mm)[:, None]

    def jacobian(self, state: State) -> Floats:
        """(N, 1, P): the unit vector between the points, in their columns."""
        between = self._between(state)
        unit = between / np.maximum(np.linalg.norm(between, axis=-1, keepdims=True), 1e-9)
        result, each = np.zeros((len(self), 1, state.width)), np.arange(len(self))
        points = result[:, 0, state.of_points].reshape(len(self), -1, 3)
        points[each, self.pairs[:, 0]], points[each, self.pairs[:, 1]] = unit, -unit
        result[:, 0, state.of_points] = points.reshape(len(self), -1)
        return result

    def errors(self, state: State) -> Floats:
        """Deviation from the certificate (N,), mm."""
        return np.abs(self.residual(state)[:, 0])

    def pick(self, which: Any) -> Self:
        """The rows at an index array or mask."""
        return replace(self, pairs=self.pairs[which], mm=self.mm[which], sigma=self.sigma[which])

    def noisier(self, factors: Floats) -> Self:
        """The same rows with their standard deviations times `factors` (1,)."""
        return replace(self, sigma=self.sigma * factors)

    def _between(self, state: State) -> Floats:
        return np.asarray(state.points[self.pairs[:, 0]] - state.points[self.pairs[:, 1]])


def _with_points(columns: Floats, of_point: Floats, point: Any, state: State, session: int) -> Floats:
    """The robot's `columns` (N, k, P of its model) and each row's own point's (N, k, 3) as columns of the whole."""
    result = np.zeros((*columns.shape[:-1], state.width))
    result[..., state.columns[session]] = columns
    points = np.zeros((len(columns), columns.shape[1], len(state.points), 3))
    points[np.arange(len(columns)), :, point] = of_point
    result[..., state.of_points] = points.reshape(*columns.shape[:2], 3 * len(state.points))
    return result


def _left_jacobian_inverse(turns: Floats) -> Floats:
    """Inverse left Jacobian of SO(3) (N, 3, 3) at rotation vectors (N, 3): 1 − ½[φ] + (1/φ² − cot(φ/2)/(2φ)) [φ]²."""
    angle = np.linalg.norm(turns, axis=-1)
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    factor = np.where(small, 1.0 / 12.0, 1.0 / safe**2 - 1.0 / (2.0 * safe * np.tan(safe / 2.0)))
    cross = np.cross(turns[:, None, :], -np.eye(3))
    return np.asarray(np.eye(3) - 0.5 * cross + factor[:, None, None] * np.matmul(cross, cross))
