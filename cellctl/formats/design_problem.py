"""A fit that is still to be measured: what is known before, and what each row would tell, for `planning.design`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from cellctl.calibration import Measured, Task
from cellctl.calibration.model.learnt_map import LearntMap
from cellctl.calibration.model.residual_model import PostureBasis
from cellctl.calibration.model.unknowns import State
from cellctl.calibration.prediction.predict import shape_columns
from cellctl.calibration.residuals.discrepancy import Discrepancy
from cellctl.formats.dataset import Cell, DataSet
from cellctl.kinematics import Bools, Floats
from cellctl.planning.design import updated

PRESENT = 0.05
"""Probability that the robot has any one of the terms that `auto` tries, as large as its prior says. An amount that is
there with probability p, else 0, has p times the variance; what a linear estimate leaves depends on variances alone
(Gauss and Markov). With p = 1 the plan of 35 touches is one for hundreds of harmonics that few robots have. Tuned on
robots that no study judges (decision 62)."""

_PART = 256


@final
@dataclass(frozen=True, eq=False)
class DesignProblem:
    """covariance (P, P): of the parameters before any row, certified distances included; 0 for those that are held.
    candidates (M, k, P): Jacobians of the rows in their standard deviations. state: about which both are.
    core (P,): which parameters the model has whatever the rows show.
    """

    covariance: Floats
    candidates: Floats
    state: State
    core: Bools

    def places(self, q: Floats) -> Floats:
        """Derivative (3 N, P), mm, of the TCPs among each other at model angles q (N, n), rad, N ≥ 4."""
        columns = shape_columns(self.state.models[0], q)
        return np.asarray(self.state.spread(columns[:, None, :], 0)[:, 0, :])


def candidate_rows(readings: Floats, columns: Mapping[str, Sequence[Cell]]) -> DataSet:
    """Rows at readings (M, n), deg, as a data set with these columns (M,) besides."""
    names = (*(f"A{axis}" for axis in range(1, readings.shape[1] + 1)), *columns)
    cells = tuple(zip(*readings.T.tolist(), *columns.values(), strict=True))
    return DataSet("candidates", names, cells, tuple(range(2, len(readings) + 2)))


def design_problem(task: Task) -> DesignProblem:
    """The problem of a task whose rows, all of one kind, are candidates as the nominal robot would show them.

    Of `auto`, whose terms the rows will decide, the model has all terms that it tries, and a discrepancy for what they
    leave, each with `PRESENT` of its prior variance.
    """
    core = {effect.group for effect in task.model.effects}
    task = task if task.candidates is None else _as_auto_may_end(task)
    state = task.fixed_by([task.model] * len(task.sessions), task.rows)
    may_be = {effect.group for effect in task.model.effects} - core
    certain = np.array([group not in may_be for group in task.unknowns(state).groups])
    return DesignProblem(_covariance(task, state, certain), _jacobian(task.rows.blocks[0], state), state, certain)


def _jacobian(block: Measured, state: State) -> Floats:
    """(M, k, P) in standard deviations; in parts, which are faster than what does not fit into the cache."""
    parts = [block.pick(np.arange(first, min(first + _PART, len(block)))) for first in range(0, len(block), _PART)]
    return np.concatenate([part.jacobian(state) / part.sigma[..., None] for part in parts])


def _as_auto_may_end(task: Task) -> Task:
    tried = [each for each in task.candidates or () if each.chosen == "tried"]
    basis = PostureBasis.over(task.rows.q)
    effects = [each for each in (*task.model.effects, *tried) if not isinstance(each, LearntMap)]
    effects.append(Discrepancy(basis.centres, basis.length_rad))
    return replace(task.with_effects(tuple(effects)), candidates=None)


def _covariance(task: Task, state: State, certain: Bools) -> Floats:
    unknowns = task.unknowns(state)
    if unknowns.prior is not None:
        known = unknowns.prior
    else:
        free = np.where(task.free_parameters(unknowns), unknowns.sigma, 0.0)
        known = np.diag(np.where(certain, 1.0, PRESENT) * free**2)
    if task.spacings is None:
        return known
    rows = task.spacings.jacobian(state) / task.spacings.sigma[..., None]
    return updated(known, rows[:, 0])
