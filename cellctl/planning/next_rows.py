"""Which rows to measure next: those that reduce the uncertainty of the robot most, by its present covariance.

The gain of a row does not depend on its reading: with Jacobian a, in its standard deviations, the posterior covariance
C becomes C − Caᵀ(1 + aCaᵀ)⁻¹aC. The value of a row is the reduction of the mean variance of the requested TCPs
(A-optimal, not D-optimal: parameters without effect on them have no value). Rows are chosen one by one, each with those
before it taken as measured. The products of all candidates A with C are not computed anew for each: AC becomes
AC − (ACaᵀ)(1 + aCaᵀ)⁻¹aC.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self, final

import numpy as np
from numpy.typing import NDArray

from cellctl.kinematics import Floats


@final
@dataclass(frozen=True, eq=False)
class Advice:
    """The most valuable rows, best first.

    chosen (K,): indices of candidates. sigma_mm (K + 1,): 1 σ, 3-D, RMS over the requested points, now and after each
    row. narrowed (K, P): each parameter's σ after the row as a share of that before, 1 where the row does not affect
    it. at_random_mm: 1 σ after as many random candidates.
    """

    chosen: tuple[int, ...]
    sigma_mm: Floats
    narrowed: Floats
    at_random_mm: float

    def beside(self, more_mm: float) -> Self:
        """With `more_mm`, 1 σ, 3-D, RMS, in each σ: what these rows do not lower."""
        return replace(
            self, sigma_mm=np.hypot(self.sigma_mm, more_mm), at_random_mm=float(np.hypot(self.at_random_mm, more_mm))
        )


def next_rows(covariance: Floats, asked: Floats, candidates: Floats, count: int) -> Advice:
    """The `count` of `candidates` that reduce the mean variance of the requested points most.

    covariance (P, P): posterior, in the parameters' units. asked (3 N, P): derivative of the requested points by the
    parameters, mm (`shape_columns`). candidates (M, k, P): Jacobians of rows in their standard deviations, filled up
    with zeros where a row has fewer than k numbers.
    """
    count = min(count, len(candidates))
    weight, points = asked.T @ asked, len(asked) / 3.0
    chosen: list[int] = []
    known, sigma, narrowed = covariance, [_sigma(covariance, weight, points)], []
    # tensordot: one product; `@` multiplies a stack one by one, three times slower
    carried = np.tensordot(candidates, covariance, 1)
    weighted = np.tensordot(carried, weight, 1)
    for _ in range(count):
        worth = _gains(candidates, carried, weighted)
        worth[chosen] = -np.inf
        best = int(np.argmax(worth))
        row, after = candidates[best], _updated(known, candidates[best])
        shared, answer = carried @ row.T, _answer(known, row)
        carried = carried - np.tensordot(shared, answer, 1)
        weighted = weighted - np.tensordot(shared, answer @ weight, 1)
        narrowed.append(_narrowed(known, after))
        known, chosen = after, [*chosen, best]
        sigma.append(_sigma(known, weight, points))
    spread = np.linspace(0, max(len(candidates) - 1, 0), count).astype(int)
    without_choice = _updated(covariance, candidates[spread].reshape(-1, len(covariance)))
    return Advice(
        chosen=tuple(chosen),
        sigma_mm=np.array(sigma),
        narrowed=np.array(narrowed).reshape(count, len(covariance)),
        at_random_mm=_sigma(without_choice, weight, points),
    )


def _gains(candidates: Floats, carried: Floats, weighted: Floats) -> Floats:
    """Reduction (M,) of trace(WC) by each of `candidates` A alone; carried: AC, weighted: ACW, all (M, k, P)."""
    spread = np.eye(candidates.shape[1]) + carried @ np.swapaxes(candidates, 1, 2)
    felt = weighted @ np.swapaxes(carried, 1, 2)
    return np.asarray(np.trace(np.linalg.solve(spread, felt), axis1=1, axis2=2))


def _updated(covariance: Floats, row: Floats) -> Floats:
    """The covariance (P, P) after a measurement with Jacobian `row` (k, P), in its standard deviations."""
    after = covariance - (row @ covariance).T @ _answer(covariance, row)
    return np.asarray((after + after.T) / 2.0)


def _answer(covariance: Floats, row: Floats) -> Floats:
    """(1 + aCaᵀ)⁻¹aC (k, P) of `row` a (k, P)."""
    carried = row @ covariance
    return np.asarray(np.linalg.solve(np.eye(len(row)) + carried @ row.T, carried))


def _sigma(covariance: Floats, weight: Floats, points: float) -> float:
    return float(np.sqrt(max(float(np.sum(weight * covariance)), 0.0) / points))


def _narrowed(before: Floats, after: Floats) -> NDArray[np.float64]:
    old, new = np.diag(before), np.diag(after)
    unsure = old > 0.0
    return np.asarray(np.sqrt(np.where(unsure, np.maximum(new, 0.0), 1.0) / np.where(unsure, old, 1.0)))
