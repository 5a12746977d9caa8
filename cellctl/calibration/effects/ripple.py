"""Which waves per turn a robot's joints have, from what a fit leaves: encoders and gears do not say it themselves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cellctl.kinematics import Floats


def order_shares(columns: Floats, residual: Floats, q: Floats, orders: Sequence[int]) -> Floats:
    """How much of the residuals' sum of squares waves of each order, in all joints together, would take away (M,).

    columns (N, k, n): how the rows' numbers move with the joints, as from `SerialChain.tool_jacobian`. residual (N, k):
    measured less model, in the same units (both divided by σ where rows differ). q (N, n): model angles, rad. orders:
    the M orders to try, waves per turn. Shares are adjusted for the 2n amounts that fit something of any noise: on
    average 0 for an order that is not there, and negative as often as not. 1 would be everything. Raises ValueError for
    residuals of no more numbers than amounts.

    A share is what this order does beside the model as it is; refitted together it does no less.
    """
    amounts, count = 2 * q.shape[1], residual.size
    if count <= amounts:
        raise ValueError(f"{count} residuals for {amounts} amounts of each order")
    total = float(np.sum(residual**2))
    if total == 0.0:
        return np.zeros(len(orders))
    left = np.array([_left(columns, residual, order * q) for order in orders])
    return np.asarray(1.0 - left / total * (count / (count - amounts)))


def _left(columns: Floats, residual: Floats, phase: Floats) -> float:
    """Sum of squares that sines and cosines of `phase` (N, n) in each joint leave."""
    waves = np.concatenate([columns * np.sin(phase)[:, None], columns * np.cos(phase)[:, None]], axis=-1)
    flat = waves.reshape(-1, waves.shape[-1])
    size = np.linalg.norm(flat, axis=0)
    unit = flat / np.where(size > 0.0, size, 1.0)  # a joint that moves nothing here has columns of zeros
    found, *_ = np.linalg.lstsq(unit, residual.ravel(), rcond=1e-9)
    return float(np.sum((residual.ravel() - unit @ found) ** 2))
