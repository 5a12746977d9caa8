"""When a campaign that measures in batches ends: at its goal, or where more rows would not pay.

**The error that is predicted.** With parameters wrong by δ ~ N(0, C) and J_n (3, P) the derivative of the n-th of N
places by them, the squared volumetric error is a quadratic form,

    e² = (1/N) Σ_n |J_n δ|² = δᵀ W δ ~ Σ_k λ_k z_k² ,

λ the eigenvalues of SᵀWS with C = SSᵀ, z independent and standard normal (`weighted_chi2_ppf`). Its root mean square
alone is no promise: half of all robots are worse than about that. What a model states besides its parameters (what a
residual model leaves open, scatter, the doubt outside the measured region; mean variance v over the places) has no
covariance between places. It is taken as one error in common on each axis, λ = v/3 three times: the widest distribution
that it can have.

**More rows.** In units of S the rows so far are worth 1, a row a (k, P) more is worth SᵀaᵀaS. Of rows that are planned,
each counts by itself; after them, as their mean does. Of v the scatter stays, and the rest is assumed to fall as the
part of the parameters does: more rows are also rows at more places.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Self, TypeAlias, final

import numpy as np

from cellctl.calibration.distributions import weighted_chi2_ppf
from cellctl.kinematics import Floats

End: TypeAlias = Literal["goal", "rows", "time", "gain"]
"""What ends a campaign: the goal is met; the most rows, or the time, are used; the next batch would gain little."""

SURE = 0.95
"""Probability with which the goal is met."""


@final
@dataclass(frozen=True)
class ErrorBand:
    """Quantiles of the predicted volumetric error, mm: 5 %, median, 95 %."""

    low_mm: float
    median_mm: float
    high_mm: float

    @classmethod
    def of(cls, weights: Floats) -> Self:
        """Of the squared error Σ λ z²; weights (K,): λ, mm²."""
        return cls(*(float(np.sqrt(weighted_chi2_ppf(p, weights))) for p in (1.0 - SURE, 0.5, SURE)))


@final
@dataclass(frozen=True, eq=False)
class PredictedError:
    """The volumetric error of a fitted model over its task, and what more rows would make of it.

    places (3 N, R), mm: derivative of the places by parameters with covariance 1, `root` (P, R) of that of the fit.
    open_mm2, scatter_mm2: mean variance of a place besides, that falls with more rows, and that no row changes.
    """

    places: Floats
    root: Floats
    open_mm2: float
    scatter_mm2: float

    @classmethod
    def of(cls, covariance: Floats, asked: Floats, open_mm2: float, scatter_mm2: float) -> Self:
        """covariance (P, P): of the fit, in the parameters' units. asked (3 N, P): derivative of the places, mm."""
        root = _root(covariance)
        return cls(asked @ root, root, open_mm2, scatter_mm2)

    @property
    def now(self) -> ErrorBand:
        """After the rows of the fit."""
        return ErrorBand.of(self._weights(np.zeros((0, self.root.shape[1]))))

    def after(self, rows: Floats, times: float = 1.0) -> ErrorBand:
        """After `rows` (M, k, P) too, Jacobians in their standard deviations; each of them `times` times."""
        return ErrorBand.of(self._weights(np.sqrt(times) * rows.reshape(-1, rows.shape[-1]) @ self.root))

    def rows_to(self, goal_mm: float, rows: Floats, most: int) -> int | None:
        """How many more rows, each worth as much as the mean of `rows` (M, k, P), meet the goal; None: not `most`."""
        if not len(rows) or self.after(rows, most / len(rows)).high_mm > goal_mm:
            return None
        few, enough = 0, most
        while enough - few > 1:
            half = (few + enough) // 2
            met = self.after(rows, half / len(rows)).high_mm <= goal_mm
            few, enough = (few, half) if met else (half, enough)
        return enough

    def _weights(self, rows: Floats) -> Floats:
        """λ (R + 3,), mm², after rows (M, R) more: of P = (1 + rowsᵀ rows)⁻¹, LLᵀ = P⁻¹, those of L⁻¹ W L⁻ᵀ."""
        factor = np.linalg.cholesky(np.eye(self.places.shape[1]) + rows.T @ rows)
        left = np.linalg.solve(factor, self.places.T)
        count = len(self.places) / 3.0
        weights = np.maximum(np.linalg.eigvalsh(left @ left.T / count), 0.0)
        fallen = weights.sum() / max(float(np.sum(self.places**2)) / count, np.finfo(float).tiny)
        return np.concatenate([weights, np.full(3, (fallen * self.open_mm2 + self.scatter_mm2) / 3.0)])


def _root(covariance: Floats) -> Floats:
    """S (P, R) with SSᵀ = C; by the correlations, because the parameters' units differ by many orders."""
    sigma = np.sqrt(np.diag(covariance))
    free = sigma > 0.0
    values, vectors = np.linalg.eigh(covariance[np.ix_(free, free)] / np.outer(sigma[free], sigma[free]))
    root = np.zeros((len(sigma), len(values)))
    root[free] = sigma[free, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    return root


def root_after(covariance: Floats, rows: Floats) -> Floats:
    """S (P, R) with SSᵀ the covariance after `rows` (M, k, P), in their standard deviations, of `covariance` before."""
    root = _root(covariance)
    seen = rows.reshape(-1, rows.shape[-1]) @ root
    factor = np.linalg.cholesky(np.eye(root.shape[1]) + seen.T @ seen)
    return np.asarray(np.linalg.solve(factor, root.T).T)


@final
@dataclass(frozen=True)
class StopLimits:
    """What ends a campaign. goal_mm: for the 95 % quantile. rows: the most for the fit. seconds: of the cell's time, 0:
    any. gain: the least by which the next batch has to lower the quantile, as a share of it.
    """

    goal_mm: float
    rows: int
    seconds: float = 0.0
    gain: float = 0.02


@final
@dataclass(frozen=True)
class BatchProgress:
    """A campaign after a batch. rows: of the fit so far; high_mm, next_mm: the 95 % quantile now and after the next
    batch. doubt: why the prediction cannot be trusted, in words. next_seconds: the time used at the end of the next
    batch.
    """

    rows: int
    high_mm: float
    next_mm: float
    next_seconds: float
    doubt: str = ""


def ended_by(limits: StopLimits, at: BatchProgress) -> End | None:
    """What ends the campaign here; None: the next batch is measured. A prediction in doubt meets no goal."""
    if at.high_mm <= limits.goal_mm and not at.doubt:
        return "goal"
    if at.rows >= limits.rows:
        return "rows"
    if limits.seconds and at.next_seconds > limits.seconds:
        return "time"
    if at.high_mm - at.next_mm < limits.gain * at.high_mm and not at.doubt:
        return "gain"
    return None
