"""The posture that status and turn of a taught position choose among those that reach it."""

from __future__ import annotations

import numpy as np
from scipy.stats import qmc

from cellctl.kinematics import Floats, JointMap, SerialChain, inverse
from cellctl.kinematics.controller_readings import status_of

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
    starts = np.vstack([near, limits[:, 0] + qmc.Sobol(len(limits), seed=0).random(_STARTS) * np.ptp(limits, axis=1)])
    found = inverse(chain, target[None], joints.model(starts), tolerance_mm=1e-7, tolerance_rad=1e-10)
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
