"""Which waves per turn a robot's joints make, from what a fit leaves: encoders and gears do not say it themselves."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from cellctl.calibration.effects.harmonics import Wave
from cellctl.kinematics import Floats

ORDERS = range(1, 49)
TOLD_APART = 0.1
"""A wave of which less than this is left beside what is fitted already is not told apart from it."""


def find_ripple(
    columns: Floats,
    residual: Floats,
    q: Floats,
    beside: Floats,
    orders: Iterable[int] = ORDERS,
    at_most: int = 60,
    doubt: float = 1e-3,
) -> tuple[Wave, ...]:
    """The waves that explain residuals best, the strongest first: orthogonal matching pursuit.

    columns (N, k, n): how the rows' numbers move with the joints. residual (N, k): measured less model. beside
    (N, k, P): how the numbers move with everything that is fitted already, so that no wave stands in for it. All three
    in the same units (divided by σ where rows differ). q (N, n): model angles, rad. Each wave is one that no noise
    would have made: the best of all candidates reaches its share by chance in less than `doubt` of the cases. What is
    left of an incomplete model is no noise; held-out rows say whether the waves are worth their amounts.

    Memory: N · k · n · 2 · orders numbers. A thousand rows or two are enough.
    """
    if not residual.size:
        return ()
    waves = [(joint + 1, order) for joint in range(q.shape[1]) for order in orders]
    pairs = _unit(_pairs(columns, q, waves))
    basis = _basis(beside.reshape(residual.size, -1))
    pairs, left = _without(basis, pairs), _without(basis, residual.reshape(-1, 1))
    free, found = residual.size - basis.shape[1], list[Wave]()
    while len(found) < at_most and free > 2:
        shares = _shares(pairs, left)
        best = int(np.argmax(shares))
        if shares[best] <= 1.0 - (doubt / len(waves)) ** (2.0 / (free - 2)):
            break
        own = _basis(pairs[:, 2 * best : 2 * best + 2])
        pairs, left = _without(own, pairs), _without(own, left)
        found.append(waves[best])
        free -= 2
    return tuple(found)


def _pairs(columns: Floats, q: Floats, waves: list[Wave]) -> Floats:
    """Sine and cosine of each wave as columns (N·k, 2W)."""
    joints, orders = np.array(waves).T
    phase = q[:, joints - 1] * orders
    both = np.stack([np.sin(phase), np.cos(phase)], axis=-1)
    moved = columns[:, :, joints - 1, None] * both[:, None]
    return np.asarray(moved.reshape(columns.shape[0] * columns.shape[1], -1))


def _unit(columns: Floats) -> Floats:
    size = np.linalg.norm(columns, axis=0)
    return np.asarray(columns / np.where(size > 0.0, size, 1.0))


def _basis(columns: Floats) -> Floats:
    """Orthonormal basis of the columns' span."""
    u, s, _ = np.linalg.svd(_unit(columns), full_matrices=False)
    return np.asarray(u[:, s > 1e-9 * max(1.0, s[0] if s.size else 1.0)])


def _without(basis: Floats, columns: Floats) -> Floats:
    return np.asarray(columns - basis @ (basis.T @ columns))


def _shares(pairs: Floats, left: Floats) -> Floats:
    """What each pair of unit columns, as far as it is left, would take of the sum of squares that is left (W,)."""
    both = np.swapaxes(pairs.reshape(len(pairs), -1, 2), 0, 1)
    grams = np.matmul(np.swapaxes(both, 1, 2), both)
    along = np.matmul(np.swapaxes(both, 1, 2), left)
    sizes, axes = np.linalg.eigh(grams)
    parts = np.matmul(np.swapaxes(axes, 1, 2), along)[..., 0] ** 2
    taken = np.where(sizes > TOLD_APART**2, parts / np.maximum(sizes, TOLD_APART**2), 0.0).sum(axis=1)
    return np.asarray(taken / max(float(np.sum(left**2)), 1e-300))
