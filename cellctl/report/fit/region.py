"""How sure the model is of tool centre points, over the joints: where the rows were, and where none was."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self, final

import numpy as np
from matplotlib.figure import Figure

from cellctl.calibration import RobotModel
from cellctl.calibration.prediction.shape import spread_over
from cellctl.kinematics import Floats
from cellctl.report.drawing import ACCENT, FAINT, svg_of
from cellctl.report.fit.story import FitStory
from cellctl.report.numbers import significant

_AWAY_DEG = 60.0
"""So far beyond the region of the fit a joint is looked at, within its limits."""

_STEPS, _SAMPLES = 25, 64
_ABREAST = 7


@final
@dataclass(frozen=True, eq=False)
class RegionSigma:
    """1 σ, 3-D, mm, of tool centre points foreseen by a model with `root` rootᵀ the covariance of its parameters.

    Of points among themselves: the rigid motion of all points of the region lower … upper (n,), rad, that is nearest to
    each of the model's possible errors is taken off, inside the region and outside it.
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
        """Postures (N, n) all over the region."""
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
        left = self._moves(q) - _motions(self.model.tcp(q)) @ self._rigid
        return np.asarray(np.sqrt(np.sum(left**2, axis=(1, 2))))

    def _moves(self, q: Floats) -> Floats:
        return np.asarray(self.model.jacobian(q)[:, :3] @ self.root)


def _motions(points: Floats) -> Floats:
    """How points (N, 3), mm, move with three slides and three turns (per metre): (N, 3, 6)."""
    turns = np.stack([np.cross(axis, points / 1000.0) for axis in np.eye(3)], axis=-1)
    return np.concatenate([np.tile(np.eye(3), (len(points), 1, 1)), turns], axis=-1)


def figures(region: RegionSigma) -> dict[str, tuple[str, str]]:
    """RMS and greatest σ over the region, as texts: in the measuring frame, and of points among themselves."""
    return {
        name: (significant(float(np.sqrt(np.mean(sigma**2)))), significant(float(sigma.max())))
        for name, sigma in (("frame", region.in_frame(region.postures)), ("among", region.among(region.postures)))
    }


def region_picture(story: FitStory, region: RegionSigma) -> list[str]:
    """σ of points among themselves as each joint goes through its reach, the others all over theirs; and the rows."""
    joints = range(region.model.n)
    groups = [joints[start : start + _ABREAST] for start in range(0, len(joints), _ABREAST)]
    return [_picture(story, region, group) for group in groups]


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


def _picture(story: FitStory, region: RegionSigma, group: Any) -> str:
    used, names = story.readings[story.used], story.joints
    curves = {joint: along_joint(story, region, joint) for joint in group}
    highest = max(float(sigma.max()) for _, sigma in curves.values()) or 1.0

    def draw(figure: Figure) -> None:
        grid = figure.subplots(1, len(group), sharey=True, squeeze=False).ravel().tolist()
        for axes, joint in zip(grid, group, strict=True):
            q, sigma = curves[joint]
            joints = story.robot.joint_map()
            at = joints.sign[joint] * (np.rad2deg(q) - joints.offset[joint])
            counts, edges = np.histogram(used[:, joint], 24, (float(at.min()), float(at.max())))
            axes.stairs(0.3 * highest * counts / max(int(counts.max()), 1), edges, fill=True, color=FAINT)
            axes.plot(at, sigma, color=ACCENT, linewidth=1.4)
            axes.set(xlabel=f"{names[joint]}, °", ylim=(0.0, 1.08 * highest))
        grid[0].set_ylabel("1 σ, mm")

    return svg_of(draw, f"region{group[0]}", 1.8, "Foreseen standard deviation of the tool over each joint")
