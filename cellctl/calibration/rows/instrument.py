"""Measurements of the tool by an instrument: positions and poses in its own frame."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self, final

import numpy as np

from cellctl.calibration.model.postures import At, Postures
from cellctl.calibration.model.robot_model import RobotModel
from cellctl.calibration.model.unknowns import State
from cellctl.calibration.rows.kind import RowsAtJoints
from cellctl.kinematics import Floats, rotation_vector


@final
@dataclass(frozen=True, eq=False)
class PositionRows(RowsAtJoints):
    """TCPs in the measuring frame. at (N): postures; xyz (N, 3) and sigma (N, 3), mm."""

    at: At
    xyz: Floats
    sigma: Floats
    session: int = 0

    one: ClassVar[str] = "position"
    many: ClassVar[str] = "positions"
    of_instrument: ClassVar[bool] = True

    @property
    def quantities(self) -> tuple[str, ...]:
        """Three coordinates."""
        return ("position",) * 3

    @property
    def positions(self) -> Floats:
        """The measured points (N, 3), mm."""
        return self.xyz

    def residual(self, state: State) -> Floats:
        """Model point minus measured point (N, 3), mm."""
        return np.asarray(self._model(state).tcp(self.postures) - self.xyz)

    def jacobian(self, state: State) -> Floats:
        """(N, 3, P)."""
        return state.spread(self._model(state).jacobian(self.postures)[:, :3], self.session)

    def errors(self, state: State) -> Floats:
        """3-D distance (N,), mm."""
        return np.asarray(np.linalg.norm(self.residual(state), axis=-1))


@final
@dataclass(frozen=True, eq=False)
class PoseRows(RowsAtJoints):
    """Tool poses in the measuring frame. at (N): postures; poses (N, 4, 4), mm; sigma (N, 6): three mm, three rad."""

    at: At
    poses: Floats
    sigma: Floats
    session: int = 0

    one: ClassVar[str] = "pose"
    many: ClassVar[str] = "poses"
    of_instrument: ClassVar[bool] = True

    @property
    def quantities(self) -> tuple[str, ...]:
        """Three coordinates, three small turns."""
        return ("position",) * 3 + ("rotation",) * 3

    @property
    def xyz(self) -> Floats:
        """The measured positions (N, 3), mm."""
        return np.asarray(self.poses[:, :3, 3])

    @property
    def positions(self) -> Floats:
        """The measured positions (N, 3), mm."""
        return self.xyz

    @property
    def orientations(self) -> Floats:
        """The measured rotations (N, 3, 3)."""
        return np.asarray(self.poses[:, :3, :3])

    def moved_to(self, postures: Postures, model: RobotModel) -> Self:
        """The model's poses at other postures: a turn of the tool is measured at its own place."""
        return replace(self, at=postures, poses=model.pose(postures))

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


def _left_jacobian_inverse(turns: Floats) -> Floats:
    """Inverse left Jacobian of SO(3) (N, 3, 3) at rotation vectors (N, 3): 1 − ½[φ] + (1/φ² − cot(φ/2)/(2φ)) [φ]²."""
    angle = np.linalg.norm(turns, axis=-1)
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    factor = np.where(small, 1.0 / 12.0, 1.0 / safe**2 - 1.0 / (2.0 * safe * np.tan(safe / 2.0)))
    cross = np.cross(turns[:, None, :], -np.eye(3))
    return np.asarray(np.eye(3) - 0.5 * cross + factor[:, None, None] * np.matmul(cross, cross))
