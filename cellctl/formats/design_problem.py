"""A fit that is still to be measured: what is known before, and what each row would tell, for `planning.design`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from cellctl.calibration import Task
from cellctl.calibration.model.learnt_map import LearntMap
from cellctl.calibration.model.residual_model import PostureBasis
from cellctl.calibration.model.unknowns import State
from cellctl.calibration.prediction.predict import shape_columns
from cellctl.calibration.residuals.discrepancy import Discrepancy
from cellctl.formats.dataset import Cell, DataSet
from cellctl.kinematics import Floats
from cellctl.planning.design import updated


@final
@dataclass(frozen=True, eq=False)
class DesignProblem:
    """covariance (P, P): of the parameters before any row, certified distances included; 0 for those that are held.
    candidates (M, k, P): Jacobians of the rows in their standard deviations. state: about which both are.
    """

    covariance: Floats
    candidates: Floats
    state: State

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
    leave.
    """
    task = task if task.candidates is None else _as_auto_may_end(task)
    state = task.fixed_by([task.model] * len(task.sessions), task.rows)
    block = task.rows.blocks[0]
    return DesignProblem(_covariance(task, state), block.jacobian(state) / block.sigma[..., None], state)


def _as_auto_may_end(task: Task) -> Task:
    tried = [each for each in task.candidates or () if each.chosen == "tried"]
    basis = PostureBasis.over(task.rows.q)
    effects = [each for each in (*task.model.effects, *tried) if not isinstance(each, LearntMap)]
    effects.append(Discrepancy(basis.centres, basis.length_rad))
    return replace(task.with_effects(tuple(effects)), candidates=None)


def _covariance(task: Task, state: State) -> Floats:
    unknowns = task.unknowns(state)
    if unknowns.prior is not None:
        known = unknowns.prior
    else:
        known = np.diag(np.where(task.free_parameters(unknowns), unknowns.sigma, 0.0) ** 2)
    if task.spacings is None:
        return known
    rows = task.spacings.jacobian(state) / task.spacings.sigma[..., None]
    return updated(known, rows[:, 0])
