"""Rows linearised about a state: each row's prediction from the others, and its distance from that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self, final

import numpy as np
from scipy.stats import chi2

from cellctl.calibration.estimation.estimate import held_beforehand, linearised
from cellctl.calibration.model.unknowns import Unknowns
from cellctl.calibration.rows import Rows
from cellctl.calibration.rows.row_blocks import RowBlocks
from cellctl.kinematics import Bools, Floats


@final
@dataclass(frozen=True, eq=False)
class Linear:
    """Rows about a state: `away + columns @ x` in standard deviations, x the unknowns in tolerances, expected at 0.

    away (N, k), columns (N, k, F): a row of fewer than k numbers is filled up with zeros; numbers (N,): count per row.
    factors (N, k): index of each number's factor of noise, one factor for each kind of number in each block; −1 where
    filled up. known (F, F), pull (F,): normal equations of everything besides these rows (tolerances, pinned
    combinations, rows that are never outliers); prior (F, F): without the rows that are never outliers.
    """

    away: Floats
    columns: Floats
    numbers: Any
    factors: Any
    known: Floats
    pull: Floats
    prior: Floats

    @classmethod
    def about(cls, unknowns: Unknowns, deviations: Floats, rows: RowBlocks, certain: Sequence[Rows]) -> Self:
        """`rows` linearised at `deviations` (P,) from the unknowns' start; `certain` rows are never outliers."""
        free = np.flatnonzero(unknowns.free)
        scale = unknowns.sigma[free]
        x = deviations[free] / scale
        state = unknowns.state(deviations)

        def of(block: Rows) -> tuple[Floats, Floats]:
            columns, away = linearised(block, state, free, scale)
            return away - columns @ x, columns

        width = max(len(block.quantities) for block in rows.blocks)
        away, columns = np.zeros((len(rows), width)), np.zeros((len(rows), width, free.size))
        factors = np.full((len(rows), width), -1)
        for block, mine, own in rows.parts():
            place = np.s_[mine, : len(block.quantities)]
            away[place], columns[place] = of(block)
            factors[place] = own.start + np.array([block.quantities.index(each) for each in block.quantities])
        prior = held_beforehand(unknowns, free)
        known, pull = prior, np.zeros(free.size)
        for own_away, lines in map(of, certain):
            known = known + np.einsum("nkp,nkq->pq", lines, lines)
            pull = pull + np.einsum("nkp,nk->p", lines, own_away)
        return cls(away, columns, rows.numbers, factors, known, pull, prior)

    def noisier(self, noise: Floats) -> Self:
        """The same rows with their standard deviations times `noise`, one for each of `RowBlocks.quantities`."""
        sigma = np.append(noise, 1.0)[self.factors]
        return replace(self, away=self.away / sigma, columns=self.columns / sigma[..., None])

    def normal(self, kept: Bools) -> tuple[Floats, Floats]:
        """Most probable unknowns x (F,) by the kept rows, and their covariance (F, F)."""
        flat, away = _flat(self.columns[kept]), self.away[kept]
        covariance = np.asarray(np.linalg.inv(self.known + flat.T @ flat), float)
        return np.asarray(-covariance @ (self.pull + flat.T @ away.reshape(-1))), covariance

    def leave_one_out_chi2(self, kept: Bools) -> tuple[Floats, Floats]:
        """Squared distance (N,) of each row from where the *other* kept rows predict it, in predicted standard
        deviations (χ² with k degrees of freedom); and the most probable unknowns by the kept rows (F,).
        """
        residual, predicted, x = self._predicted(kept)
        return squared_distances(residual, predicted), x

    def scatter(self, kept: Bools) -> Floats:
        """Ratio (Q,) of actual to stated scatter of each kind of number about predictions by the *other* kept rows: by
        the median of all, so that a few outliers do not count; 1 for a factor without numbers.
        """
        residual, predicted, _ = self._predicted(kept)
        squares = residual**2 / np.diagonal(predicted, axis1=-2, axis2=-1)
        result = np.ones(int(self.factors.max()) + 1)
        for each in self._kinds:
            result[each] = np.sqrt(np.median(squares[self.factors == each]) / chi2.median(1))
        return result

    def _predicted(self, kept: Bools) -> tuple[Floats, Floats, Floats]:
        """Residuals (N, k), their covariances (N, k, k) by the *other* kept rows; unknowns x (F,) by all of them."""
        x, covariance = self.normal(kept)
        spread = (_flat(self.columns) @ covariance).reshape(self.columns.shape) @ np.swapaxes(self.columns, -1, -2)
        side = np.where(kept, -1.0, 1.0)[:, None, None]  # a kept row's own effect on x is removed
        predicted = np.eye(spread.shape[-1]) + side * spread + 1e-9 * np.eye(spread.shape[-1])
        return self.away + self.columns @ x, predicted, x

    def misfit(self, kept: Bools, x: Floats) -> float:
        """χ² of the kept rows about the model, and of the unknowns x (F,) about their prior."""
        return float(np.sum((self.away[kept] + self.columns[kept] @ x) ** 2) + x @ self.prior @ x)

    def seen(self, noise: Floats) -> float:
        """Natural logarithm of the ratio by which all rows, their standard deviations times `noise` (Q,), shrink the
        volume of possible x.
        """
        square = self.known + np.einsum("q,qfg->fg", noise[self._kinds] ** -2.0, self._squares)
        return float(0.5 * np.linalg.slogdet(square)[1])

    @cached_property
    def _kinds(self) -> Any:
        """Factors that have numbers."""
        return np.unique(self.factors[self.factors >= 0])

    @cached_property
    def _squares(self) -> Floats:
        """JᵀJ of the numbers of each of `_kinds`: (their count, F, F)."""
        lines = (self.columns[self.factors == each] for each in self._kinds)
        return np.stack([mine.T @ mine for mine in lines])


def squared_distances(residual: Floats, covariance: Floats) -> Floats:
    """rᵀS⁻¹r (N,) of residuals r (N, k) with covariances S (N, k, k)."""
    return np.asarray(np.einsum("nk,nk->n", residual, np.linalg.solve(covariance, residual[..., None])[..., 0]))


def _flat(columns: Floats) -> Floats:
    """Columns (N, k, F) as (N k, F), also without any unknown."""
    return columns.reshape(columns.shape[0] * columns.shape[1], columns.shape[2])
