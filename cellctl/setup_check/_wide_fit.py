"""Whether rows and robot file belong to one robot, if no set-up error explains the misfit.

All parameters are fitted within very wide tolerances. A robot that lost its mastering, has an untaught tool, or was
measured with a tape comes near to its rows in this way. If the residual is still far beyond the robot class, there are
two ways to show that robot file and rows do not belong together, and that the rows are not just noisy:

- they are hardly nearer than rows whose measurements were shuffled against the joints (shifted or mixed rows);
- the residual is a function of the joints, which noise is not (another robot's file).

If little is left, the lengths of the links are compared: rows of another robot of the same family fit well, with
lengths that no robot of the file's make has.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self, final

import numpy as np

from cellctl.calibration.identification.identify import certified_rows
from cellctl.calibration.model.parameter import Parameter
from cellctl.calibration.model.unknowns import State
from cellctl.calibration.rows import Measured
from cellctl.calibration.solver.estimate import Estimate, estimate
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

OFF = 10.0
OFF_MM = 5.0
"""A length further from the robot file than this many tolerances, and than this, is wrong. By default both are 5 mm:
the worst robots miss by 5 mm at the TCP, with the errors of all their links and joints together."""

LENGTH_SIGMAS = 3.0
"""A length is wrong only if it is so for all values within this many σ."""

WEIGHTS = ((3.0, 0.3), (1.0, 1.0), (1.0, 0.3), (1.0, 0.1))
RIDGES = (1e-6, 1e-4, 1e-2, 1e-1, 1.0, 10.0)


@final
@dataclass(frozen=True, slots=True)
class WrongLength:
    """A length that the rows contradict: its deviation from the robot file, and the 1 σ of that, mm."""

    parameter: Parameter
    deviation_mm: float
    sigma_mm: float

    @property
    def at_least_mm(self) -> float:
        """The smallest deviation that the rows allow, mm."""
        return abs(self.deviation_mm) - LENGTH_SIGMAS * self.sigma_mm


@final
@dataclass(frozen=True, slots=True)
class WideFit:
    """The residual, mm, RMS over the nearest rows, before and after a fit within wide tolerances; the prediction of
    tolerances before any fit; if the residual is plausible, the wrong lengths, the largest deviation first; if not, the
    residual of shuffled rows, and the share of the residual variance that the joints predict.

    tolerance_mm: 1 σ of lengths, as the robot file states it, or the default.
    """

    nominal_mm: float
    left_mm: float
    predicted_mm: float
    tolerance_mm: float
    wrong_lengths: tuple[WrongLength, ...] = ()
    shuffled_mm: float = np.inf
    systematic: float = 0.0

    @classmethod
    def of(cls, setup: Setup) -> Self:
        """The fit of the rows of `setup`, and of shuffled ones; 150 rows are enough."""
        nominal = misfit(setup).with_prediction(setup)
        fitted, kept = _fitted(setup, nominal)
        state, tolerance = fitted.state, setup.task.tolerances.link_mm
        found = cls(nominal.mm, _rms_residual(setup, state, kept), nominal.predicted_mm, tolerance)
        if not found.implausible:
            noise = max(found.left_mm / found.predicted_mm, 1.0)
            return replace(found, wrong_lengths=_wrong_lengths(fitted, noise, tolerance))
        rng = np.random.default_rng(0)
        others = [_shuffled(setup, rng) for _ in range(SHUFFLES)]
        shuffled = [_rms_after_fit(other) for other in others]
        return replace(found, shuffled_mm=float(np.median(shuffled)), systematic=_predicted_by_joints(setup, state))

    @property
    def implausible(self) -> bool:
        """Whether the residual is beyond any robot of the class."""
        return self.left_mm > max(IMPLAUSIBLE * self.predicted_mm, LEAST_MM)

    @property
    def impossible(self) -> bool:
        """Whether a length is wrong beyond the wide tolerances: not even a file measured with a tape is so far off."""
        limit = WIDENED["links"] * max(self.tolerance_mm, OFF_MM / OFF)
        return any(length.at_least_mm > limit for length in self.wrong_lengths)

    @property
    def unrelated(self) -> bool:
        """Whether robot file and rows do not fit together."""
        other_robot = self.left_mm > SYSTEMATIC_MM and self.systematic > SYSTEMATIC
        return self.implausible and (NEARER * self.left_mm > self.shuffled_mm or other_robot)


def _fitted(setup: Setup, nominal: Misfit) -> tuple[Estimate, list[Any]]:
    """The fit within wide tolerances to the nearest rows, and which these are, by block."""
    task = replace(setup.task, prior=None, groups=None, candidates=None, rough=None)
    unknowns = task.unknowns(nominal.state)
    unknowns = unknowns.masked(task.free_parameters(unknowns)).with_prior_scale(WIDENED)
    kept, begin = list(nominal.kept), None
    for _ in range(ROUNDS):
        blocks = [_as_uncertain(block, nominal.predicted_mm) for block in only(task.rows, kept).blocks if len(block)]
        found = estimate(unknowns, [*blocks, *certified_rows(task)], begin)
        begin = found.deviations
        kept = [nearest(errors) for errors, _ in row_errors(task, found.state)]
    return found, kept


def _wrong_lengths(fitted: Estimate, noise: float, tolerance_mm: float) -> tuple[WrongLength, ...]:
    """The wrong lengths of the links or axes; noise: what the stated σ are multiplied with."""
    sigmas = noise * np.sqrt(np.diag(fitted.covariance))
    lengths = [
        WrongLength(parameter, float(deviation), float(sigma))
        for parameter, deviation, sigma in zip(fitted.unknowns.parameters, fitted.deviations, sigmas, strict=True)
        if parameter.group == "links" and not parameter.turns
    ]
    wrong = [length for length in lengths if length.at_least_mm > max(OFF * tolerance_mm, OFF_MM)]
    return tuple(sorted(wrong, key=lambda length: -abs(length.deviation_mm)))


def _as_uncertain(block: Measured, mm: float) -> Measured:
    """The block with its standard deviations raised in proportion, to `mm` in the median of its distances."""
    lengths = block.sigma[:, block.of_length]
    return block.changed(sigma=block.sigma * max(mm / float(np.median(lengths)), 1.0))


def _rms_residual(setup: Setup, state: State, kept: list[Any]) -> float:
    parts = [errors[which] for (errors, _), which in zip(row_errors(setup.task, state), kept, strict=True)]
    return rms(np.concatenate(parts))


def _rms_after_fit(setup: Setup) -> float:
    fitted, kept = _fitted(setup, misfit(setup).with_prediction(setup))
    return _rms_residual(setup, fitted.state, kept)


def _shuffled(setup: Setup, rng: np.random.Generator) -> Setup:
    """Measurements at other rows' joints; for touches, all similar, each joint is shuffled separately."""
    readings, start = setup.readings.copy(), 0
    for block in setup.task.rows.blocks:
        mine = slice(start, start + len(block))
        together = block.positions is not None
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
