"""σ of the TCP over the joints: inside the measured joint region, and outside it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Self, final

import numpy as np

from cellctl.calibration import RobotModel
from cellctl.calibration.prediction.shape import spread_over
from cellctl.kinematics import Floats
from cellctl.report.fit.story import FitStory

_AWAY_DEG = 60.0
"""Distance beyond the region of the fit that is evaluated for a joint, within its limits."""

_STEPS, _SAMPLES = 25, 64


@final
@dataclass(frozen=True, eq=False)
class RegionSigma:
    """1 σ, 3-D, mm, of TCPs predicted by a model whose parameters have the covariance `root` rootᵀ.

    Points among themselves: the rigid motion of all points of the region lower … upper (n,), rad, that is nearest to
    each possible error of the model is subtracted, inside the region and outside it.
    """

    model: RobotModel
    root: Floats
    lower: Floats
    upper: Floats

    @classmethod
    def of(cls, story: FitStory) -> Self:
        """Of a fit, over the joints of its rows."""
        found, robot = story.found, story.found.unknowns.robot
        values, vectors = np.linalg.eigh(found.covariance[:robot, :robot])
        q = story.task.rows.pick(story.used).q
        return cls(found.state.model, vectors * np.sqrt(np.maximum(values, 0.0)), q.min(axis=0), q.max(axis=0))

    @cached_property
    def postures(self) -> Floats:
        """Postures (N, n) spread over the region."""
        return spread_over(self.lower, self.upper)

    @cached_property
    def _rigid(self) -> Floats:
        """The rigid motion (6, K) nearest to each error."""
        columns, moves = _motions(self.model.tcp(self.postures)), self._moves(self.postures)
        return np.asarray(np.linalg.lstsq(columns.reshape(-1, 6), moves.reshape(-1, moves.shape[-1]), rcond=None)[0])

    def in_frame(self, q: Floats) -> Floats:
        """1 σ (N,) at q (N, n) in the measuring frame: base and heading count."""
        return np.asarray(np.sqrt(np.sum(self._moves(q) ** 2, axis=(1, 2))))

    def among(self, q: Floats) -> Floats:
        """1 σ (N,) at q (N, n) relative to the region."""
        left = self._moves(q) - np.tensordot(_motions(self.model.tcp(q)), self._rigid, 1)
        return np.asarray(np.sqrt(np.sum(left**2, axis=(1, 2))))

    def _moves(self, q: Floats) -> Floats:
        # tensordot: one product; `@` multiplies a stack one by one, several times slower
        return np.asarray(np.tensordot(self.model.jacobian(q)[:, :3], self.root, 1))


def _motions(points: Floats) -> Floats:
    """Motion of points (N, 3), mm, with three translations and three rotations (per metre): (N, 3, 6)."""
    turns = np.stack([np.cross(axis, points / 1000.0) for axis in np.eye(3)], axis=-1)
    return np.concatenate([np.tile(np.eye(3), (len(points), 1, 1)), turns], axis=-1)


def figures(region: RegionSigma) -> tuple[dict[str, float], dict[str, float]]:
    """RMS and maximum σ over the region, mm: in the measuring `frame`, and of points `among` themselves."""
    sigmas = {"frame": region.in_frame(region.postures), "among": region.among(region.postures)}
    rms = {name: float(np.sqrt(np.mean(sigma**2))) for name, sigma in sigmas.items()}
    return rms, {name: float(sigma.max()) for name, sigma in sigmas.items()}


def curves(story: FitStory, region: RegionSigma) -> list[tuple[Floats, Floats]]:
    """Of each joint: its readings (S,), deg, and σ of points among themselves there, mm, the other joints varied."""
    joints, found = story.robot.joint_map(), [along_joint(story, region, joint) for joint in range(region.model.n)]
    return [
        (joints.sign[joint] * (np.rad2deg(q) - joints.offset[joint]), sigma) for joint, (q, sigma) in enumerate(found)
    ]


def along_joint(story: FitStory, region: RegionSigma, joint: int) -> tuple[Floats, Floats]:
    """Model angles (S,), rad, of `joint`, and σ there, RMS over the others, mm."""
    away, limits = np.deg2rad(_AWAY_DEG), story.limits[joint]
    first = min(region.lower[joint], max(limits[0], region.lower[joint] - away))
    last = max(region.upper[joint], min(limits[1], region.upper[joint] + away))
    at = np.linspace(first, last, _STEPS)
    q = np.tile(region.postures[:_SAMPLES], (_STEPS, 1, 1))
    q[:, :, joint] = at[:, None]
    sigma = region.among(q.reshape(-1, q.shape[-1])).reshape(_STEPS, -1)
    return at, np.sqrt(np.mean(sigma**2, axis=1))
