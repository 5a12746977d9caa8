"""Kinds of measurement, each a block of rows: how far the model is from them, and how that changes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Protocol, Self, final

import numpy as np

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
        """Derivative of `residual` (N, k, P) by the model's parameters, then the centres' x, y, z."""
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

    q: Floats
    sigma: Floats

    def __len__(self) -> int:
        return len(self.sigma)

    def noisier(self, factors: Floats) -> Self:
        return replace(self, sigma=self.sigma * factors)  # type: ignore[type-var]  # every kind is a dataclass


@final
@dataclass(frozen=True, eq=False)
class PositionRows(_RowsAtJoints):
    """Tool centre points in the measuring frame. q (N, n), rad; xyz (N, 3) and sigma (N, 3), mm."""

    q: Floats
    xyz: Floats
    sigma: Floats

    @property
    def quantities(self) -> tuple[str, ...]:
        """Three coordinates."""
        return ("position",) * 3

    def residual(self, state: State) -> Floats:
        """Model point minus measured point (N, 3), mm."""
        return np.asarray(state.model.tip(self.q) - self.xyz)

    def jacobian(self, state: State) -> Floats:
        """(N, 3, P)."""
        return _with_centres(state.model.jacobian(self.q)[:, :3], state)

    def errors(self, state: State) -> Floats:
        """3-D distance (N,), mm."""
        return np.asarray(np.linalg.norm(self.residual(state), axis=-1))

    def pick(self, which: Any) -> Self:
        """The rows at an index array or mask."""
        return replace(self, q=self.q[which], xyz=self.xyz[which], sigma=self.sigma[which])


@final
@dataclass(frozen=True, eq=False)
class PoseRows(_RowsAtJoints):
    """Tool poses in the measuring frame. q (N, n), rad; poses (N, 4, 4), mm; sigma (N, 6): three mm, three rad."""

    q: Floats
    poses: Floats
    sigma: Floats

    @property
    def quantities(self) -> tuple[str, ...]:
        """Three coordinates, three small turns."""
        return ("position",) * 3 + ("rotation",) * 3

    def residual(self, state: State) -> Floats:
        """Model minus measured position, and the turn from measured to model, in the measuring frame (N, 6)."""
        pose = state.model.pose(self.q)
        turn = np.matmul(pose[:, :3, :3], np.swapaxes(self.poses[:, :3, :3], -1, -2))
        return np.concatenate([pose[:, :3, 3] - self.poses[:, :3, 3], rotation_vector(turn)], axis=-1)

    def jacobian(self, state: State) -> Floats:
        """(N, 6, P). The turn's derivative is J_l⁻¹(φ) ω: exact for a residual turn φ of any size below π."""
        columns = state.model.jacobian(self.q)
        turned = np.matmul(_left_jacobian_inverse(self.residual(state)[:, 3:]), columns[:, 3:])
        return _with_centres(np.concatenate([columns[:, :3], turned], axis=1), state)

    def errors(self, state: State) -> Floats:
        """3-D distance of the positions (N,), mm."""
        return np.asarray(np.linalg.norm(self.residual(state)[:, :3], axis=-1))

    def pick(self, which: Any) -> Self:
        """The rows at an index array or mask."""
        return replace(self, q=self.q[which], poses=self.poses[which], sigma=self.sigma[which])


@final
@dataclass(frozen=True, eq=False)
class TouchRows(_RowsAtJoints):
    """Touches on spheres. q (N, n), rad; sphere (N,): index of its centre; reach (N,): sphere radius + tip radius, mm;
    sigma (N, 1), mm, along the sphere's normal.
    """

    q: Floats
    sphere: Any
    reach: Floats
    sigma: Floats

    @property
    def quantities(self) -> tuple[str, ...]:
        """One distance."""
        return ("position",)

    def residual(self, state: State) -> Floats:
        """Distance of the tip's centre from the sphere's surface, tip radius allowed for (N, 1), mm."""
        away = state.model.tip(self.q) - state.centres[self.sphere]
        return np.asarray(np.linalg.norm(away, axis=-1) - self.reach)[:, None]

    def jacobian(self, state: State) -> Floats:
        """(N, 1, P): the tip's motion along the normal, less the centre's."""
        away = state.model.tip(self.q) - state.centres[self.sphere]
        normal = away / np.maximum(np.linalg.norm(away, axis=-1, keepdims=True), 1e-9)
        along = np.einsum("nr,nrp->np", normal, state.model.jacobian(self.q)[:, :3])
        centres = np.zeros((len(self), len(state.centres), 3))
        centres[np.arange(len(self)), self.sphere] = -normal
        return np.concatenate([along, centres.reshape(len(self), -1)], axis=-1)[:, None]

    def errors(self, state: State) -> Floats:
        """Distance to the sphere's surface (N,), mm."""
        return np.abs(self.residual(state)[:, 0])

    def pick(self, which: Any) -> Self:
        """The rows at an index array or mask."""
        return replace(
            self, q=self.q[which], sphere=self.sphere[which], reach=self.reach[which], sigma=self.sigma[which]
        )


@final
@dataclass(frozen=True, eq=False)
class SpacingRows:
    """Certified distances between sphere centres. pairs (N, 2): indices of centres; mm (N,); sigma (N, 1), mm."""

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
        """Distance of the centres minus the certified one (N, 1), mm."""
        return np.asarray(np.linalg.norm(self._between(state), axis=-1) - self.mm)[:, None]

    def jacobian(self, state: State) -> Floats:
        """(N, 1, P): the unit vector between the centres, in their columns."""
        between = self._between(state)
        unit = between / np.maximum(np.linalg.norm(between, axis=-1, keepdims=True), 1e-9)
        robot, each = len(state.model.parameters), np.arange(len(self))
        centres = np.zeros((len(self), len(state.centres), 3))
        centres[each, self.pairs[:, 0]], centres[each, self.pairs[:, 1]] = unit, -unit
        return np.concatenate([np.zeros((len(self), robot)), centres.reshape(len(self), -1)], axis=-1)[:, None]

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
        return np.asarray(state.centres[self.pairs[:, 0]] - state.centres[self.pairs[:, 1]])


def _with_centres(columns: Floats, state: State) -> Floats:
    """`columns` (N, k, P) with zero columns for the centres, on which they do not depend."""
    if not state.centres.size:
        return columns
    return np.concatenate([columns, np.zeros((*columns.shape[:-1], state.centres.size))], axis=-1)


def _left_jacobian_inverse(turns: Floats) -> Floats:
    """Inverse left Jacobian of SO(3) (N, 3, 3) at rotation vectors (N, 3): 1 − ½[φ] + (1/φ² − cot(φ/2)/(2φ)) [φ]²."""
    angle = np.linalg.norm(turns, axis=-1)
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    factor = np.where(small, 1.0 / 12.0, 1.0 / safe**2 - 1.0 / (2.0 * safe * np.tan(safe / 2.0)))
    cross = np.cross(turns[:, None, :], -np.eye(3))
    return np.asarray(np.eye(3) - 0.5 * cross + factor[:, None, None] * np.matmul(cross, cross))
