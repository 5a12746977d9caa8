"""Which rows to measure next: those that reduce the uncertainty of the robot most, by its present covariance.

The gain of a row does not depend on its reading: with Jacobian a, in its standard deviations, the posterior covariance
C becomes C − Caᵀ(1 + aCaᵀ)⁻¹aC. The value of a row is the reduction of the mean variance of the requested TCPs
(A-optimal, not D-optimal: parameters without effect on them have no value). Rows are chosen one by one, each with those
before it taken as measured.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

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
    for _ in range(count):
        worth = gains(known, weight, candidates)
        worth[chosen] = -np.inf
        best = int(np.argmax(worth))
        after = updated(known, candidates[best])
        narrowed.append(_narrowed(known, after))
        known, chosen = after, [*chosen, best]
        sigma.append(_sigma(known, weight, points))
    spread = np.linspace(0, max(len(candidates) - 1, 0), count).astype(int)
    without_choice = updated(covariance, candidates[spread].reshape(-1, len(covariance)))
    return Advice(
        chosen=tuple(chosen),
        sigma_mm=np.array(sigma),
        narrowed=np.array(narrowed).reshape(count, len(covariance)),
        at_random_mm=_sigma(without_choice, weight, points),
    )


def gains(covariance: Floats, weight: Floats, candidates: Floats) -> Floats:
    """Reduction of trace(weight · covariance) by each of `candidates` (M, k, P) alone; weight (P, P)."""
    carried = candidates @ covariance
    spread = np.eye(candidates.shape[1]) + carried @ np.swapaxes(candidates, 1, 2)
    felt = (carried @ weight) @ np.swapaxes(carried, 1, 2)
    return np.asarray(np.trace(np.linalg.solve(spread, felt), axis1=1, axis2=2))


def updated(covariance: Floats, row: Floats) -> Floats:
    """The covariance (P, P) after a measurement with Jacobian `row` (k, P), in its standard deviations."""
    carried = row @ covariance
    after = covariance - carried.T @ np.linalg.solve(np.eye(len(row)) + carried @ row.T, carried)
    return np.asarray((after + after.T) / 2.0)


def _sigma(covariance: Floats, weight: Floats, points: float) -> float:
    return float(np.sqrt(max(float(np.sum(weight * covariance)), 0.0) / points))


def _narrowed(before: Floats, after: Floats) -> NDArray[np.float64]:
    old, new = np.diag(before), np.diag(after)
    unsure = old > 0.0
    return np.asarray(np.sqrt(np.where(unsure, np.maximum(new, 0.0), 1.0) / np.where(unsure, old, 1.0)))
