"""Whether rows and robot file belong to one robot, if no set-up error explains the misfit.

All parameters are fitted within very wide tolerances. A robot that lost its mastering, has an untaught tool, or was
measured with a tape comes near to its rows in this way. If the residual is still far beyond the robot class, there are
two ways to show that robot file and rows do not belong together, and that the rows are not just noisy:

- they are hardly nearer than rows whose measurements were shuffled against the joints (shifted or mixed rows);
- the residual is a function of the joints, which noise is not (another robot's file).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self, final

import numpy as np

from cellctl.calibration.estimation.estimate import estimate
from cellctl.calibration.estimation.identify import certain
from cellctl.calibration.model.unknowns import State
from cellctl.calibration.rows import Measured, PoseRows, PositionRows
from cellctl.kinematics import Floats
from cellctl.setup_check.hypothesis import Setup
from cellctl.setup_check.misfit import IMPLAUSIBLE, LEAST_MM, Misfit, misfit, nearest, only, rms, row_errors

WIDENED = {"links": 40.0, "zeros": 200.0, "tool": 100.0}
"""Tolerances are widened by these factors: by default to links within 20 mm and 2°, as a tape measures them, joint
zeros within 10°, and a tool within 200 mm."""

ROUNDS = 3
SHUFFLES = 3

NEARER = 20.0
"""Rows nearer than shuffled ones by less than this factor are hardly nearer. A real robot's rows are nearer by
hundreds."""

SYSTEMATIC = 0.5
SYSTEMATIC_MM = 5.0
"""A robot file is another robot's if the residual is larger than this, and the joints predict this share of it."""

WEIGHTS = ((3.0, 0.3), (1.0, 1.0), (1.0, 0.3), (1.0, 0.1))
RIDGES = (1e-6, 1e-4, 1e-2, 1e-1, 1.0, 10.0)


@final
@dataclass(frozen=True, slots=True)
class WideFit:
    """The residual, mm, RMS over the nearest rows, after a fit within wide tolerances; the prediction of tolerances
    before any fit; and, if that is implausible, the residual of shuffled rows, and the share of the residual variance
    that the joints predict.
    """

    left_mm: float
    predicted_mm: float
    shuffled_mm: float = np.inf
    systematic: float = 0.0

    @classmethod
    def of(cls, setup: Setup) -> Self:
        """The fit of the rows of `setup`, and of shuffled ones; 150 rows are enough."""
        nominal = misfit(setup).with_prediction(setup)
        state, kept = _fitted(setup, nominal)
        found = cls(_left(setup, state, kept), nominal.predicted_mm)
        if not found.implausible:
            return found
        rng = np.random.default_rng(0)
        others = [_shuffled(setup, rng) for _ in range(SHUFFLES)]
        shuffled = [_left(other, *_fitted(other, misfit(other).with_prediction(other))) for other in others]
        return replace(found, shuffled_mm=float(np.median(shuffled)), systematic=_predicted_by_joints(setup, state))

    @property
    def implausible(self) -> bool:
        """Whether the residual is beyond any robot of the class."""
        return self.left_mm > max(IMPLAUSIBLE * self.predicted_mm, LEAST_MM)

    @property
    def unrelated(self) -> bool:
        """Whether robot file and rows do not fit together."""
        other_robot = self.left_mm > SYSTEMATIC_MM and self.systematic > SYSTEMATIC
        return self.implausible and (NEARER * self.left_mm > self.shuffled_mm or other_robot)


def _fitted(setup: Setup, nominal: Misfit) -> tuple[State, list[Any]]:
    """The fit within wide tolerances to the nearest rows, and which these are, by block."""
    task = replace(setup.task, prior=None, groups=None, candidates=None, rough=None)
    unknowns = task.unknowns(nominal.state)
    unknowns = unknowns.masked(task.identification(unknowns)).with_prior_scale(WIDENED)
    kept, begin, state = list(nominal.kept), None, nominal.state
    for _ in range(ROUNDS):
        blocks = [_as_uncertain(block, nominal.predicted_mm) for block in only(task.rows, kept).blocks if len(block)]
        found = estimate(unknowns, [*blocks, *certain(task)], begin)
        begin, state = found.deviations, found.state
        kept = [nearest(errors) for errors, _ in row_errors(task, state)]
    return state, kept


def _as_uncertain(block: Measured, mm: float) -> Measured:
    """The block with its standard deviations raised in proportion, to `mm` in the median of its distances."""
    lengths = block.sigma[:, block.of_length]
    return block.changed(sigma=block.sigma * max(mm / float(np.median(lengths)), 1.0))


def _left(setup: Setup, state: State, kept: list[Any]) -> float:
    parts = [errors[which] for (errors, _), which in zip(row_errors(setup.task, state), kept, strict=True)]
    return rms(np.concatenate(parts))


def _shuffled(setup: Setup, rng: np.random.Generator) -> Setup:
    """Measurements at other rows' joints; for touches, all similar, each joint is shuffled separately."""
    readings, start = setup.readings.copy(), 0
    for block in setup.task.rows.blocks:
        mine = slice(start, start + len(block))
        together = isinstance(block, PositionRows | PoseRows)
        own = readings[mine]
        readings[mine] = own[rng.permutation(len(own))] if together else rng.permuted(own, axis=0)
        start += len(block)
    return setup.with_readings(readings)


def _predicted_by_joints(setup: Setup, state: State) -> float:
    """The share of the residual variance of all rows that rows at similar joints predict: leave-one-out, kernel ridge
    regression; the best of `WEIGHTS` and `RIDGES`.
    """
    total, missed = 0.0, np.zeros((len(WEIGHTS), len(RIDGES)))
    for block in setup.task.rows.blocks:
        if len(block) < 2:
            continue
        left = block.deviation(state)[:, block.of_length]
        left = left - left.mean(axis=0)
        total += float(np.sum(left**2))
        kernels = [_kernel(block.q, *weights) for weights in WEIGHTS]
        missed += [[_missed(kernel, ridge, left) for ridge in RIDGES] for kernel in kernels]
    return 1.0 - float(missed.min()) / total if total else 0.0


def _kernel(q: Floats, arm: float, wrist: float) -> Floats:
    """Similarity (N, N) of postures q (N, n), rad. A product over the joints, as the TCP is a sum of products of their
    sines and cosines; the first half of the joints, with the longest lever, has its own weight.
    """
    weights = np.where(np.arange(q.shape[1]) < q.shape[1] / 2, arm, wrist)
    apart = q[:, None] - q[None]
    return np.asarray(np.prod((1.0 + weights * np.cos(apart)) / (1.0 + weights), axis=-1))


def _missed(kernel: Floats, ridge: float, left: Floats) -> float:
    """Sum of squared errors of the prediction of each row's `left` (N, k) from all other rows."""
    hat = kernel @ np.linalg.inv(kernel + ridge * np.eye(len(kernel)))
    return float(np.sum(((left - hat @ left) / (1.0 - np.diag(hat))[:, None]) ** 2))
