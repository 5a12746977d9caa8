"""Linearised rows, and their cross-validation: each row's prediction from the others, without a new fit.

The rows are linearised once, about a fit of all of them: r + J x. With A = Σ_i J_iᵀJ_i + C⁻¹ and b = Σ_i J_iᵀr_i, a
fold T is left out by A_T = A − Σ_T J_iᵀJ_i, b_T = b − Σ_T J_iᵀr_i; its rows are predicted at x_T = −A_T⁻¹ b_T with
covariance I + J_i A_T⁻¹ J_iᵀ. Any subset of the unknowns is another model, from the same sums: a ladder of models in a
hundred folds costs a hundred Cholesky factors each. What is lost is the change of J between the fits, second order in
the fold's effect.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self, final

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from cellctl.calibration.distributions import chi2_ppf
from cellctl.calibration.folds import evenly
from cellctl.calibration.model.unknowns import Unknowns
from cellctl.calibration.rows import Rows
from cellctl.calibration.rows.row_blocks import RowBlocks
from cellctl.calibration.solver.estimate import held_beforehand, linearised
from cellctl.calibration.solver.evidence import Factor, NormalEquations, System
from cellctl.kinematics import Bools, Floats


@final
@dataclass(frozen=True, eq=False)
class Linear:
    """Rows about a state: `residual + jacobian @ x` in standard deviations, x the unknowns in tolerances, 0 where
    expected.

    residual (N, k), at x = 0; jacobian (N, k, F). A row of fewer than k numbers is filled up with zeros. numbers (N,):
    count per row. factors (N, k): index of each number's factor of noise, one factor for each kind of number in each
    block; −1 where filled up. known (F, F), Jtr (F,), rtr: normal equations of everything besides these rows
    (tolerances, pinned combinations, rows that are never outliers).
    """

    residual: Floats
    jacobian: Floats
    numbers: Any
    factors: Any
    known: Floats
    Jtr: Floats
    rtr: float

    @classmethod
    def about(cls, unknowns: Unknowns, deviations: Floats, rows: RowBlocks, certified: Sequence[Rows]) -> Self:
        """`rows` linearised at `deviations` (P,) from the unknowns' start; `certified` rows are never outliers."""
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
        known, Jtr, rtr = held_beforehand(unknowns, free), np.zeros(free.size), 0.0
        for own_away, lines in map(of, certified):
            known = known + np.einsum("nkp,nkq->pq", lines, lines)
            Jtr = Jtr + np.einsum("nkp,nk->p", lines, own_away)
            rtr += float(np.sum(own_away**2))
        return cls(away, columns, rows.numbers, factors, known, Jtr, rtr)

    def noisier(self, noise: Floats) -> Self:
        """The same rows with their standard deviations times `noise`, one for each of `RowBlocks.quantities`."""
        sigma = np.append(noise, 1.0)[self.factors]
        return replace(self, residual=self.residual / sigma, jacobian=self.jacobian / sigma[..., None])

    def normal(self, kept: Bools) -> tuple[Floats, Floats]:
        """Most probable unknowns x (F,) by the kept rows, and their covariance (F, F)."""
        flat, away = _flat(self.jacobian[kept]), self.residual[kept]
        covariance = np.asarray(np.linalg.inv(self.known + flat.T @ flat), float)
        return np.asarray(-covariance @ (self.Jtr + flat.T @ away.reshape(-1))), covariance

    def leave_one_out_chi2(self, kept: Bools) -> tuple[Floats, Floats]:
        """Squared distance (N,) of each row from where the *other* kept rows predict it, in predicted standard
        deviations (χ² with k degrees of freedom); and the most probable unknowns by the kept rows (F,).
        """
        residual, predicted, x = self._predicted(kept)
        return squared_distances(residual, predicted), x

    def scatter(self, kept: Bools) -> Floats:
        """Ratio (Q,) of actual to stated scatter of each kind of number about predictions by the *other* kept rows: by
        the median of all, so that a few outliers do not count; 1 for a factor without numbers. A squared standard
        normal number has the median χ²₀.₅(1) = 0.455, by which that of the squares is divided.
        """
        residual, predicted, _ = self._predicted(kept)
        squares = residual**2 / np.diagonal(predicted, axis1=-2, axis2=-1)
        result = np.ones(int(self.factors.max()) + 1)
        for each in self._kinds:
            result[each] = np.sqrt(np.median(squares[self.factors == each]) / chi2_ppf(0.5, 1))
        return result

    def _predicted(self, kept: Bools) -> tuple[Floats, Floats, Floats]:
        """Residuals (N, k), their covariances (N, k, k) by the *other* kept rows; unknowns x (F,) by all of them."""
        x, covariance = self.normal(kept)
        spread = (_flat(self.jacobian) @ covariance).reshape(self.jacobian.shape) @ np.swapaxes(self.jacobian, -1, -2)
        # r is about all kept rows. Its covariance is I − H_ii for a kept row, which pulled x towards itself, and
        # I + J A⁻¹ Jᵀ for one left out. 1e-9: a row that alone determines a parameter has H_ii = 1 and r = 0
        side = np.where(kept, -1.0, 1.0)[:, None, None]
        predicted = np.eye(spread.shape[-1]) + side * spread + 1e-9 * np.eye(spread.shape[-1])
        return self.residual + self.jacobian @ x, predicted, x

    def misfit(self, kept: Bools, x: Floats) -> float:
        """χ² of the kept rows and of the rows that are never outliers about the model, and of the unknowns x (F,) about
        their prior: at the x of `normal` its least value, so that a row that is left out takes its leave-one-out χ²
        off.
        """
        kept_rows = float(np.sum((self.residual[kept] + self.jacobian[kept] @ x) ** 2))
        return kept_rows + self.rtr + float(2.0 * self.Jtr @ x + x @ self.known @ x)

    def half_log_det(self, noise: Floats) -> float:
        """½ ln|A| with all rows, also those left out, their standard deviations times `noise` (Q,): the Occam factor,
        by which the rows shrink the volume of possible x. ½ ln|C| is not in it: noise does not change it.
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
        lines = (self.jacobian[self.factors == each] for each in self._kinds)
        return np.stack([mine.T @ mine for mine in lines])


def squared_distances(residual: Floats, covariance: Floats) -> Floats:
    """rᵀS⁻¹r (N,) of residuals r (N, k) with covariances S (N, k, k)."""
    return np.asarray(np.einsum("nk,nk->n", residual, np.linalg.solve(covariance, residual[..., None])[..., 0]))


def _flat(columns: Floats) -> Floats:
    """Columns (N, k, F) as (N k, F), also without any unknown."""
    return columns.reshape(columns.shape[0] * columns.shape[1], columns.shape[2])


@final
@dataclass(frozen=True, eq=False)
class Predicted:
    """Held-out rows as the others predict them: residual (N, k) in stated σ, its covariance (N, k, k), error (N,), mm,
    and indices of these rows; `placed`: which of them first fixed their own point or session.
    """

    residual: Floats
    covariance: Floats
    errors: Floats
    rows: Any
    placed: Bools

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """All folds, one after another."""
        columns = zip(*((p.residual, p.covariance, p.errors, p.rows, p.placed) for p in parts), strict=True)
        return cls(*(np.concatenate(column) for column in columns))


@final
@dataclass(frozen=True, eq=False)
class Folded:
    """Rows linearised about a fit, and their folds.

    system: all rows' normal equations, of all unknowns (F,). length_sigma_mm (N, k): σ of each number that
    is a length, 0 of a turn. folds: each fold's rows and their normal equations. registering (F,): unknowns that tie
    rows to the robot; held-out rows may have to find these themselves.
    """

    linear: Linear
    system: System
    length_sigma_mm: Floats
    folds: tuple[tuple[Any, Mapping[Factor, NormalEquations]], ...]
    registering: Bools

    @classmethod
    def of(
        cls,
        unknowns: Unknowns,
        deviations: Floats,
        rows: RowBlocks,
        certified: Sequence[Rows],
        folds: Sequence[Any],
        registering: Bools,
    ) -> Self:
        """`rows` with their stated σ, linearised at `deviations` (P,) from the unknowns' start."""
        linear = Linear.about(unknowns, deviations, rows, certified)
        system = System.of(unknowns, deviations, rows, certified)
        mm = np.zeros(linear.residual.shape)
        for block, mine, _ in rows.parts():
            mm[mine, : len(block.quantities)] = block.sigma * block.of_length
        own = tuple((test, _normals(linear, test)) for test in folds)
        return cls(linear, system, mm, own, registering[unknowns.free])

    def with_folds(self, folds: Sequence[Any]) -> Self:
        """The same rows with other folds."""
        return replace(self, folds=tuple((test, _normals(self.linear, test)) for test in folds))

    def predicted(
        self, kept: Bools, logs: Mapping[Factor, float], most: int | None = None, *, again: bool = False
    ) -> Predicted:
        """Each fold's rows as the others predict them with only the unknowns `kept` (F,), and these logarithms of noise
        and prior scales. most: rows used of each fold. again: the others estimate noise and scales again, without the
        fold, from these start values. Without it `logs` come from all rows, the fold among them: many prior scales (30
        of harmonics) of 60 rows without any harmonics make their gain 2 to 4 % of the error too large (simulated).
        """
        at = np.flatnonzero(kept)
        system = self.system.restricted(kept)
        return Predicted.joined([self._fold(system, at, test, own, logs, most, again) for test, own in self.folds])

    def noise(self, logs: Mapping[Factor, float]) -> Floats:
        """The scale of each number's σ (N, k); 0 where a row has fewer numbers."""
        scales = np.zeros(int(self.linear.factors.max()) + 2)  # the last one is for factor −1
        for number in range(len(scales) - 1):
            scales[number] = np.exp(logs.get(("noise", number), 0.0))
        return np.asarray(scales[self.linear.factors])

    def _fold(
        self,
        system: System,
        at: Any,
        test: Any,
        own: Mapping[Factor, NormalEquations],
        logs: Mapping[Factor, float],
        most: int | None,
        again: bool,
    ) -> Predicted:
        left = {f: n.without(own[f].restricted(at)) if f in own else n for f, n in system.numbers.items()}
        others = replace(system, numbers=left)
        if again:
            logs, _ = others.tuned(logs)
        JtJ, Jtr = others.posterior(logs)
        root = factored(JtJ)
        x = -cho_solve(root, Jtr, check_finite=False)
        shown = evenly(test, most)
        columns = self.linear.jacobian[shown][..., at]
        residual = self.linear.residual[shown] + columns @ x
        flat = columns.reshape(-1, len(at))
        answers = cho_solve(root, flat.T, check_finite=False).T.reshape(columns.shape)
        covariance = np.matmul(columns, np.swapaxes(answers, -1, -2))
        noise = self.noise(logs)[shown]
        # a number that fills up a row has residual 0 and variance 1: it changes neither χ² nor the determinant
        covariance = covariance + np.where(noise > 0.0, noise**2, 1.0)[:, :, None] * np.eye(noise.shape[1])
        residual, placed = self._placed(residual, columns, at, shown, left)
        errors = np.linalg.norm(residual * self.length_sigma_mm[shown], axis=1)
        return Predicted(residual, covariance, errors, shown, np.full(len(shown), placed))

    def _placed(
        self, residual: Floats, columns: Floats, at: Any, test: Any, left: Mapping[Factor, NormalEquations]
    ) -> tuple[Floats, bool]:
        """Residuals after a fit of what only these rows determine (a point, a session); whether there is any.

        Their covariance is not reduced by what this fit absorbs. So these rows count in gains (errors of both models
        shrink alike), and not in coverage or σ outside (`Reliability`).
        """
        known = np.sum([np.diag(normal.JtJ) for normal in left.values()], axis=0) if left else np.zeros(len(at))
        there = np.einsum("nkf,nkf->f", columns, columns)
        # 1e-9: the sums without the fold are differences, and what the others do not determine is rounding
        unknown = self.registering[at] & (known <= 1e-9 * there) & (there > 0.0)
        if not unknown.any():
            return residual, False
        mine = columns[..., unknown].reshape(residual.size, -1)
        step = np.linalg.lstsq(mine, residual.reshape(-1), rcond=1e-9)[0]
        return residual - (mine @ step).reshape(residual.shape), True


def factored(square: Floats) -> Any:
    """Cholesky factor. A fold is taken off the sums by subtraction: of an unobservable parameter the rounding error can
    exceed the flat prior. Then each gets a share of its own size, far below what its rows show.
    """
    try:
        return cho_factor(square, lower=True, check_finite=False)
    except LinAlgError:
        return cho_factor(square + 1e-9 * np.diag(np.diag(square)), lower=True, check_finite=False)


def _normals(linear: Linear, test: Any) -> dict[Factor, NormalEquations]:
    """The normal equations of the rows `test`, by factor of noise."""
    factors, columns, away = linear.factors[test], linear.jacobian[test], linear.residual[test]
    found: dict[Factor, NormalEquations] = {}
    for factor in np.unique(factors[factors >= 0]):
        mine = factors == factor
        found["noise", int(factor)] = NormalEquations.of(columns[mine], away[mine])
    return found
