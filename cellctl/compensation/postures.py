"""A start posture where none is given: of those that reach the target, the one nearest to the middle of a box."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cellctl.kinematics import Floats, SerialChain, inverse

_TRIES = 24
"""Starts for each target; a wrist robot has up to eight postures for one."""

_TURN = 2.0 * np.pi


def postures(chain: SerialChain, targets: ArrayLike, low: ArrayLike, high: ArrayLike) -> Floats:
    """Model angles (N, n), rad, that put the TCP at `targets` (N, 4, 4); NaN rows where no posture was found.

    Searched from starts spread over the box `low`…`high` (n,), rad, the same each time; of those found within the box
    the one nearest to its middle, in shares of its width.
    """
    goals, lower, upper = np.asarray(targets, float), np.asarray(low, float), np.asarray(high, float)
    middle, half = (lower + upper) / 2.0, np.maximum((upper - lower) / 2.0, 1e-9)
    shares = np.concatenate([np.zeros((1, chain.n)), np.random.default_rng(0).uniform(-0.9, 0.9, (_TRIES, chain.n))])
    found = inverse(chain, goals[None], (middle + half * shares)[:, None], tolerance_mm=1e-6, tolerance_rad=1e-9)
    q = middle + (found.q - middle + np.pi) % _TURN - np.pi
    share = np.abs(q - middle) / half
    usable = found.converged & (share <= 1.0).all(axis=-1)
    cost = np.where(usable, np.sum(share**2, axis=-1), np.inf)
    best = np.argmin(cost, axis=0)
    row = np.arange(len(goals))
    return np.asarray(np.where(np.isfinite(cost[best, row])[:, None], q[best, row], np.nan))
