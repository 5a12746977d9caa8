"""Which of the postures that reach a target: the one that status and turn state, or the one near a box's middle."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cellctl.kinematics import Floats, JointMap, SerialChain, inverse_from_all, nearest_turn
from cellctl.kinematics.controller_readings import status_of
from cellctl.kinematics.low_discrepancy import spread_over

_TRIES = 24
"""Starts for each target; a wrist robot has up to eight postures for one."""


def postures(chain: SerialChain, targets: ArrayLike, low: ArrayLike, high: ArrayLike) -> Floats:
    """Model angles (N, n), rad, that put the TCP at `targets` (N, 4, 4); NaN rows where no posture was found.

    Searched from starts spread over the box `low`…`high` (n,), rad, the same each time; of those found within the box
    the one nearest to its middle, in shares of its width.
    """
    goals, lower, upper = np.asarray(targets, float), np.asarray(low, float), np.asarray(high, float)
    middle, half = (lower + upper) / 2.0, np.maximum((upper - lower) / 2.0, 1e-9)
    shares = np.concatenate([np.zeros((1, chain.n)), np.random.default_rng(0).uniform(-0.9, 0.9, (_TRIES, chain.n))])
    found = inverse_from_all(chain, goals, middle + half * shares, tolerance_mm=1e-6, tolerance_rad=1e-9)
    q = nearest_turn(found.q, middle, np.pi)
    share = np.abs(q - middle) / half
    usable = found.converged & (share <= 1.0).all(axis=-1)
    cost = np.where(usable, np.sum(share**2, axis=-1), np.inf)
    best = np.argmin(cost, axis=0)
    row = np.arange(len(goals))
    return np.asarray(np.where(np.isfinite(cost[best, row])[:, None], q[best, row], np.nan))


_STARTS = 64
_AT_ZERO_DEG = 1e-3
"""Nearer to 0 a reading counts as either sign."""

_STATUS_BITS = 7
"""Higher bits of a status do not choose a posture."""


def stated_posture(
    chain: SerialChain,
    joints: JointMap,
    limits: Floats,
    target: Floats,
    near: Floats,
    *,
    status: int | None = None,
    turn: int | None = None,
) -> Floats | None:
    """Readings (n,), deg, that put the TCP at `target` (4, 4), mm, inside `limits` (n, 2), deg; None: there are none.

    status, turn: as KUKA controllers number them; None: any. Of several postures the one nearest to `near` (n,), deg.
    """
    starts = np.vstack([near, spread_over(limits[:, 0], limits[:, 1], _STARTS, seed=0)])
    found = inverse_from_all(chain, target[None], joints.model(starts), tolerance_mm=1e-7, tolerance_rad=1e-10)
    readings = _with_whole_turns(joints.readings(found.q[found.converged]), limits, near, turn)
    if status is not None and len(readings):
        readings = readings[status_of(chain, joints, readings) == status & _STATUS_BITS]
    if not len(readings):
        return None
    return np.asarray(readings[np.argmin(np.abs(readings - near).sum(axis=1))])


def _with_whole_turns(readings: Floats, limits: Floats, near: Floats, turn: int | None) -> Floats:
    """Readings (M, n) shifted by whole turns into the limits, with the signs of `turn`, as near as possible to `near`;
    those for which there is no such shift are left out.
    """
    shifted = readings[..., None] + 360.0 * np.arange(-2, 3)
    usable = (shifted >= limits[:, :1]) & (shifted <= limits[:, 1:])
    if turn is not None:
        below = ((turn >> np.arange(len(limits))) & 1).astype(bool)[:, None]
        usable &= np.where(below, shifted < _AT_ZERO_DEG, shifted > -_AT_ZERO_DEG)
    cost = np.where(usable, np.abs(shifted - near[:, None]), np.inf)
    best = np.argmin(cost, axis=-1)[..., None]
    chosen = np.take_along_axis(shifted, best, axis=-1)[..., 0]
    return np.asarray(chosen[np.isfinite(np.take_along_axis(cost, best, axis=-1)).all(axis=(1, 2))])
