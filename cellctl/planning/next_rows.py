"""Which rows to measure next: those after which the robot is known best, by what is known of it now.

What a row will read is not needed to say what it will teach: with Jacobian a, in its standard deviations, the posterior
covariance C becomes C − Caᵀ(1 + aCaᵀ)⁻¹aC. The worth of a row is how much that lowers the mean variance of the tool
centre points asked for (A-optimal, not D-optimal: what nobody asks for is worth nothing). Rows are chosen one by one,
each with those before it taken as measured.
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
    """The rows worth most, best first.

    chosen (K,): indices of candidates. sigma_mm (K + 1,): 1 σ, 3-D, RMS over the points asked for, now and after each.
    narrowed (K, P): each parameter's σ after the row as a share of that before it, 1 where the row says nothing of it.
    at_random_mm: 1 σ after as many candidates taken without choosing.
    """

    chosen: tuple[int, ...]
    sigma_mm: Floats
    narrowed: Floats
    at_random_mm: float


def next_rows(covariance: Floats, asked: Floats, candidates: Floats, count: int) -> Advice:
    """The `count` of `candidates` that lower the mean variance of the points asked for the most.

    covariance (P, P): posterior, in the parameters' units. asked (3 N, P): how the points asked for move with the
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
    """By how much each of `candidates` (M, k, P) alone lowers trace(weight · covariance); weight (P, P)."""
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
