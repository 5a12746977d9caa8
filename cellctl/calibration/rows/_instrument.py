"""Measurements of the tool by an instrument: positions and poses in its own frame.

A full covariance of a row becomes independent numbers by an invertible matrix W of the row: W C Wᵀ = diag(sigma²).
Residual and Jacobian are multiplied by it, so that the estimator meets independent numbers only.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self, final

import numpy as np

from cellctl.calibration.model.postures import At, Postures
from cellctl.calibration.model.robot_model import RobotModel
from cellctl.calibration.model.unknowns import State
from cellctl.calibration.rows._kind import Reachable, RowsAtJoints
from cellctl.kinematics import Floats, rotation_vector


class _InstrumentRows(RowsAtJoints):
    """Rows with a matrix `decorrelation` (N, k, k) each, or None where the numbers are independent.

    datum (N,): index of the unknown zero of the instrument's range, −1: none; None: none in any row. The measured point
    is further from the measuring frame's origin, where the instrument is, by that zero.
    """

    decorrelation: Floats | None
    datum: Any

    model_error_scale: ClassVar[float] = 1.0
    model_error_freedom: ClassVar[float] = np.inf

    @property
    def zeros(self) -> Any:
        """Each row's datum (N,)."""
        return np.full(len(self), -1) if self.datum is None else self.datum

    def residual(self, state: State) -> Floats:
        """`deviation` as independent numbers (N, k), their standard deviations `sigma`."""
        away = self.deviation(state)
        return away if self.decorrelation is None else np.einsum("nij,nj->ni", self.decorrelation, away)

    def _columns(self, columns: Floats, state: State) -> Floats:
        """Derivative (N, k, `width`) of `residual`, by that of model pose (N, k, P) and the zero of the range."""
        result = state.spread(columns, self.session)
        if self.datum is not None:
            known = np.flatnonzero(self.datum >= 0)
            result[known, :3, state.datums_at + self.datum[known]] = self._beams[known]
        return result if self.decorrelation is None else np.matmul(self.decorrelation, result)

    def _beyond(self, state: State) -> Floats | float:
        """By what the measured points (N, 3) are too far from the instrument, mm."""
        if self.datum is None:
            return 0.0
        return np.asarray(np.append(state.datums, 0.0)[self.datum][:, None] * self._beams)  # -1: the last one, 0

    @property
    def _beams(self) -> Floats:
        """Unit vectors (N, 3) from the instrument to the measured points."""
        assert self.positions is not None
        return np.asarray(self.positions / np.maximum(np.linalg.norm(self.positions, axis=1, keepdims=True), 1e-9))

    def proposed(self, state: State, reachable: Reachable) -> Self:
        """Anywhere in and near the measured volume."""
        at, model = reachable.anywhere(), self._model(state)
        there = self.moved_to(at, model).with_positions(model.tcp(at))
        return there.changed(sigma=self.usual_sigma(len(at)), decorrelation=None, datum=None)

    def errors(self, state: State) -> Floats:
        """3-D distance of the positions (N,), mm."""
        return np.asarray(np.linalg.norm(self.deviation(state)[:, :3], axis=-1))


def independent(covariance: Floats) -> tuple[Floats, Floats]:
    """sigma (N, k) and matrices (N, k, k) that make numbers of these covariances (N, k, k) independent; k is 3 or 6.

    Positions: their principal axes. Turns, if any, less what the position predicts of them (C_tp C_pp⁻¹), along the
    principal axes of the rest: so the first three numbers stay lengths and the last three angles, each with a noise
    scale of its own (a Cholesky or eigenvector root of the whole matrix would mix mm and rad). Raises LinAlgError or
    ValueError where a covariance is not positive definite.
    """
    count, size = covariance.shape[:2]
    matrices = np.tile(np.eye(size), (count, 1, 1))
    place = covariance[:, :3, :3]
    variances, axes = np.linalg.eigh(place)
    matrices[:, :3, :3] = np.swapaxes(axes, 1, 2)
    if size > 3:
        answer = covariance[:, 3:, :3] @ np.linalg.inv(place)
        of_turns, turned = np.linalg.eigh(covariance[:, 3:, 3:] - answer @ covariance[:, :3, 3:])
        back = np.swapaxes(turned, 1, 2)
        matrices[:, 3:, :3], matrices[:, 3:, 3:] = -back @ answer, back
        variances = np.concatenate([variances, of_turns], axis=1)
    if not (variances > 0.0).all():
        raise ValueError("a covariance is not positive definite")
    return np.sqrt(variances), matrices


@final
@dataclass(frozen=True, eq=False)
class PositionRows(_InstrumentRows):
    """TCPs in the measuring frame. at (N): postures; xyz (N, 3), mm; sigma (N, 3), mm, along x, y, z.

    decorrelation (N, 3, 3): makes the numbers of a row independent, with standard deviations `sigma`; see `of`.
    """

    at: At
    xyz: Floats
    sigma: Floats
    session: int = 0
    decorrelation: Floats | None = None
    datum: Any = None

    @classmethod
    def of(cls, at: At, xyz: Floats, covariance: Floats, session: int = 0) -> Self:
        """Rows with full covariances (N, 3, 3), mm². Raises ValueError where one is not positive definite."""
        sigma, decorrelation = independent(covariance)
        return cls(at, xyz, sigma, session, decorrelation)

    one: ClassVar[str] = "position"
    many: ClassVar[str] = "positions"
    of_instrument: ClassVar[bool] = True
    in_setup_check: ClassVar[bool] = True

    @property
    def quantities(self) -> tuple[str, ...]:
        """Three coordinates."""
        return ("position",) * 3

    @property
    def positions(self) -> Floats:
        """The measured points (N, 3), mm."""
        return self.xyz

    def with_positions(self, xyz: Floats) -> Self:
        """Other measured points (N, 3), mm."""
        return replace(self, xyz=xyz)

    def deviation(self, state: State) -> Floats:
        """Model point minus measured point (N, 3), mm."""
        return np.asarray(self._model(state).tcp(self.postures) - self.xyz + self._beyond(state))

    def jacobian(self, state: State) -> Floats:
        """(N, 3, P)."""
        return self._columns(self._model(state).jacobian(self.postures)[:, :3], state)


@final
@dataclass(frozen=True, eq=False)
class PoseRows(_InstrumentRows):
    """Tool poses in the measuring frame. at (N): postures; poses (N, 4, 4), mm; sigma (N, 6): three mm, three rad.

    decorrelation (N, 6, 6): makes the numbers of a row independent, with standard deviations `sigma`; see `of`.
    """

    at: At
    poses: Floats
    sigma: Floats
    session: int = 0
    decorrelation: Floats | None = None
    datum: Any = None

    @classmethod
    def of(cls, at: At, poses: Floats, covariance: Floats, session: int = 0) -> Self:
        """Rows with full covariances (N, 6, 6) of slide (mm) and turn (rad) along the measuring frame's axes.

        Raises ValueError where one is not positive definite.
        """
        sigma, decorrelation = independent(covariance)
        return cls(at, poses, sigma, session, decorrelation)

    one: ClassVar[str] = "pose"
    many: ClassVar[str] = "poses"
    of_instrument: ClassVar[bool] = True
    in_setup_check: ClassVar[bool] = True

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

    def with_positions(self, xyz: Floats) -> Self:
        """Other measured positions (N, 3), mm, with the same orientations."""
        poses = self.poses.copy()
        poses[:, :3, 3] = xyz
        return replace(self, poses=poses)

    def with_orientations(self, rotations: Floats) -> Self:
        """Other measured rotations (N, 3, 3), at the same positions."""
        poses = self.poses.copy()
        poses[:, :3, :3] = rotations
        return replace(self, poses=poses)

    def errors_and_turns(self, state: State) -> tuple[Floats, Floats]:
        """Distances (N,), mm, and angles (N,), rad, from measured to model."""
        away = self.deviation(state)
        return np.linalg.norm(away[:, :3], axis=-1), np.linalg.norm(away[:, 3:], axis=-1)

    def moved_to(self, postures: Postures, model: RobotModel) -> Self:
        """The model's poses at other postures: a turn of the tool is measured at its own place."""
        return replace(self, at=postures, poses=model.pose(postures))

    def deviation(self, state: State) -> Floats:
        """Model minus measured position, and the turn from measured to model, in the measuring frame (N, 6)."""
        pose = self._model(state).pose(self.postures)
        turn = np.matmul(pose[:, :3, :3], np.swapaxes(self.poses[:, :3, :3], -1, -2))
        away = pose[:, :3, 3] - self.poses[:, :3, 3] + self._beyond(state)
        return np.concatenate([away, rotation_vector(turn)], axis=-1)

    def jacobian(self, state: State) -> Floats:
        """(N, 6, P). The turn's derivative is J_l⁻¹(φ) ω: exact for a residual turn φ of any size below π."""
        columns = self._model(state).jacobian(self.postures)
        turned = np.matmul(_left_jacobian_inverse(self.deviation(state)[:, 3:]), columns[:, 3:])
        return self._columns(np.concatenate([columns[:, :3], turned], axis=1), state)


def _left_jacobian_inverse(turns: Floats) -> Floats:
    """Inverse left Jacobian of SO(3) (N, 3, 3) at rotation vectors (N, 3): 1 − ½[φ] + (1/φ² − cot(φ/2)/(2φ)) [φ]².

    Solà, Deray and Atchuthan 2018, A micro Lie theory for state estimation in robotics, eq. 146. The factor of [φ]² is
    1/12 + φ²/720 + …: below 1e-4 rad 1/12 is exact, and the two terms would cancel.
    """
    angle = np.linalg.norm(turns, axis=-1)
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    factor = np.where(small, 1.0 / 12.0, 1.0 / safe**2 - 1.0 / (2.0 * safe * np.tan(safe / 2.0)))
    cross = np.cross(turns[:, None, :], -np.eye(3))
    return np.asarray(np.eye(3) - 0.5 * cross + factor[:, None, None] * np.matmul(cross, cross))
