"""The estimator: the most probable parameters given rows and tolerances, by Levenberg–Marquardt in tolerance units.

Every unknown is divided by its prior σ and every row by its own: cost, steps and singular values then have no unit. The
rows are folded into a triangle block by block (QR), so that memory does not grow with their number and precision is not
squared away as in normal equations.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from cellctl.calibration.rows import Rows
from cellctl.calibration.unknowns import State, Unknowns
from cellctl.kinematics import Floats

BLOCK = 2048
"""Rows linearised at a time."""

ITERATIONS = 60
SETTLED = 1e-9
"""A step that would lower the cost (a χ²) by less than this, absolutely or relative to it, is the last."""


@final
@dataclass(frozen=True, eq=False)
class Estimate:
    """The outcome of a fit.

    deviations (P,): from the start, mm, rad, 1/(N·m²), 0 where not free. covariance (P, P): of the posterior, 0 where
    not free. triangle (F, F): R of the *data alone* at the solution, columns in tolerances, free parameters only.
    ended: how it ended, in words.
    """

    unknowns: Unknowns
    deviations: Floats
    covariance: Floats
    triangle: Floats
    cost: float
    iterations: int
    converged: bool
    ended: str

    @property
    def state(self) -> State:
        """The identified robot and centres."""
        return self.unknowns.state(self.deviations)

    @property
    def seen_by_data(self) -> float:
        """How many parameters' worth the data determined; the tolerances determined the rest of the free ones."""
        squares = np.linalg.svd(self.triangle, compute_uv=False) ** 2
        return float(np.sum(squares / (1.0 + squares)))


def estimate(unknowns: Unknowns, blocks: Sequence[Rows]) -> Estimate:
    """Fit the free unknowns to `blocks`, from where they are expected. Always ends; says whether it converged."""
    free = np.flatnonzero(unknowns.free)
    scale = unknowns.sigma[free]
    x, damping, ended, converged = np.zeros(free.size), 0.0, "", False
    cost = _cost(unknowns, blocks, free, x * scale) + float(x @ x)
    iteration = 0
    for iteration in range(1, ITERATIONS + 1):
        triangle, right = _fold(unknowns, blocks, free, scale, x)
        step, promise = _step(triangle, right, x, damping)
        if promise <= SETTLED * (1.0 + cost):
            converged, ended = True, f"converged in {iteration} iterations"
            break
        tried = x + step
        new_cost = _cost(unknowns, blocks, free, tried * scale) + float(tried @ tried)
        if new_cost < cost:
            x, cost, damping = tried, new_cost, damping * 0.1 if damping > 1e-9 else 0.0
        elif damping < 1e6:
            damping = max(damping * 10.0, 1e-9)
        else:
            ended = "no step lowers the residual any further: rows contradict the model, or each other"
            break
    else:
        ended = f"still improving after {ITERATIONS} iterations: the start is far from the measurements"
    triangle, _ = _fold(unknowns, blocks, free, scale, x)
    covariance = np.zeros((len(unknowns.names),) * 2)
    covariance[np.ix_(free, free)] = _posterior(triangle) * np.outer(scale, scale)
    deviations = np.zeros(len(unknowns.names))
    deviations[free] = x * scale
    return Estimate(unknowns, deviations, covariance, triangle, cost, iteration, converged, ended)


def _spread(unknowns: Unknowns, free: np.ndarray, values: Floats) -> Floats:
    deviations = np.zeros(len(unknowns.names))
    deviations[free] = values
    return deviations


def _cost(unknowns: Unknowns, blocks: Sequence[Rows], free: np.ndarray, values: Floats) -> float:
    state = unknowns.state(_spread(unknowns, free, values))
    return float(sum(np.sum((rows.residual(state) / rows.sigma) ** 2) for rows in _parts(blocks)))


def _fold(
    unknowns: Unknowns, blocks: Sequence[Rows], free: np.ndarray, scale: Floats, x: Floats
) -> tuple[Floats, Floats]:
    """Triangle R (F, F) and right side (F,) of the linearised rows in tolerance units: R·step ≈ −right."""
    state = unknowns.state(_spread(unknowns, free, x * scale))
    folded = np.zeros((0, free.size + 1))
    for rows in _parts(blocks):
        columns = rows.jacobian(state)[..., free] * scale / rows.sigma[..., None]
        residual = (rows.residual(state) / rows.sigma)[..., None]
        both = np.concatenate([columns, residual], axis=-1).reshape(-1, free.size + 1)
        folded = np.asarray(np.linalg.qr(np.vstack([folded, both]), mode="r"))
    square = np.zeros((free.size, free.size + 1))
    kept = folded[: free.size]
    square[: len(kept)] = kept
    return square[:, :-1], square[:, -1]


def _parts(blocks: Sequence[Rows]) -> Iterable[Rows]:
    for rows in blocks:
        for start in range(0, len(rows), BLOCK):
            yield rows if len(rows) <= BLOCK else rows.pick(np.s_[start : start + BLOCK])


def _step(triangle: Floats, right: Floats, x: Floats, damping: float) -> tuple[Floats, float]:
    """Damped step (F,) and the fall in cost that an undamped one promises; the prior is one row per unknown."""
    unit = np.eye(x.size)
    stacked, residual = np.vstack([triangle, unit]), np.concatenate([right, x])
    u, s, vt = np.linalg.svd(stacked, full_matrices=False)
    along = u.T @ residual
    return np.asarray(-vt.T @ (s / (s**2 + damping * s[0] ** 2) * along)), float(along @ along)


def _posterior(triangle: Floats) -> Floats:
    """Posterior covariance (F, F) in tolerance units: (RᵀR + 1)⁻¹."""
    _, s, vt = np.linalg.svd(triangle)
    return np.asarray((vt.T / (1.0 + s**2)) @ vt)
