"""Inverse kinematics by damped Newton steps from a start, for a whole batch at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.kinematics._chain import SerialChain
from cellctl.kinematics._frames import Bools, Floats, pose_difference


@final
@dataclass(frozen=True)
class InverseResult:
    """q (..., n), rad: the best angles found; converged (...): within tolerance; error_mm, error_rad (...)."""

    q: Floats
    converged: Bools
    error_mm: Floats
    error_rad: Floats


def inverse(
    chain: SerialChain,
    poses: ArrayLike,
    start: ArrayLike,
    *,
    tolerance_mm: float = 1e-9,
    tolerance_rad: float = 1e-12,
    iterations: int = 50,
    step_rad: float = 0.5,
) -> InverseResult:
    """Joint angles that put the TCP at `poses` (..., 4, 4), mm, near `start` (..., n), rad.

    Levenberg–Marquardt on the pose error, lengths in units of the arm's reach: a singular or unreachable pose ends near
    its nearest point with `converged` false, without an error. No joint moves more than `step_rad` in a step. Joint
    limits are the caller's: a result may lie outside, on the branch that Newton keeps from the start.
    """
    targets, begin = np.asarray(poses, float), np.asarray(start, float)
    batch = np.broadcast_shapes(targets.shape[:-2], begin.shape[:-1])
    goal = np.broadcast_to(targets, (*batch, 4, 4)).reshape(-1, 4, 4)
    q = np.array(np.broadcast_to(begin, (*batch, chain.n)).reshape(-1, chain.n))
    reach = max(chain.reach_mm, 1.0)
    damping = np.full(len(q), 1e-6)
    error = pose_difference(goal, chain.forward(q))
    active = ~_within(error, tolerance_mm, tolerance_rad)
    for _ in range(iterations):
        rows = np.flatnonzero(active)
        if not rows.size:
            break
        tried = q[rows] + _steps(chain.tool_jacobian(q[rows]), error[rows], damping[rows], reach, step_rad)
        new_error = pose_difference(goal[rows], chain.forward(tried))
        better = _size(new_error, reach) < _size(error[rows], reach)
        q[rows[better]], error[rows[better]] = tried[better], new_error[better]
        damping[rows] = np.maximum(damping[rows] * np.where(better, 1e-2, 1e2), 1e-12)
        active[rows] = ~_within(error[rows], tolerance_mm, tolerance_rad) & (damping[rows] < 1e6)
    return InverseResult(
        q.reshape(*batch, chain.n),
        _within(error, tolerance_mm, tolerance_rad).reshape(batch),
        np.linalg.norm(error[:, :3], axis=-1).reshape(batch),
        np.linalg.norm(error[:, 3:], axis=-1).reshape(batch),
    )


def inverse_from_all(
    chain: SerialChain, poses: ArrayLike, starts: ArrayLike, *, tolerance_mm: float, tolerance_rad: float
) -> InverseResult:
    """`inverse` of each of `poses` (N, 4, 4), mm, from each of `starts` (S, n), rad: arrays (S, N, …).

    Newton's steps stay on the branch of their start, and a wrist robot has up to eight postures for one pose: starts
    spread over the joints find most of them.
    """
    goals, begin = np.asarray(poses, float)[None], np.asarray(starts, float)[:, None]
    return inverse(chain, goals, begin, tolerance_mm=tolerance_mm, tolerance_rad=tolerance_rad)


def nearest_turn(angles: Floats, near: Floats, half_turn: float) -> Floats:
    """`angles` (..., n) shifted by whole turns to within half a turn of `near`; half_turn: 180.0 or π, the unit."""
    return np.asarray(near + (angles - near + half_turn) % (2.0 * half_turn) - half_turn)


def _within(error: Floats, tolerance_mm: float, tolerance_rad: float) -> Bools:
    place, turn = np.linalg.norm(error[:, :3], axis=-1), np.linalg.norm(error[:, 3:], axis=-1)
    return np.asarray((place <= tolerance_mm) & (turn <= tolerance_rad))


def _size(error: Floats, reach: float) -> Floats:
    return np.asarray(np.sum((error[:, :3] / reach) ** 2, axis=-1) + np.sum(error[:, 3:] ** 2, axis=-1))


def _steps(jacobian: Floats, error: Floats, damping: Floats, reach: float, limit: float) -> Floats:
    """Damped Gauss–Newton steps (N, n), each shortened so that no joint moves more than `limit`."""
    scale = np.array([1.0 / reach] * 3 + [1.0] * 3)
    scaled, residual = jacobian * scale[:, None], error * scale
    transposed = np.swapaxes(scaled, -1, -2)
    normal = np.matmul(transposed, scaled) + damping[:, None, None] * np.eye(jacobian.shape[-1])
    step = np.linalg.solve(normal, np.matmul(transposed, residual[..., None]))[..., 0]
    longest = np.max(np.abs(step), axis=-1, keepdims=True)
    return np.asarray(step * np.minimum(1.0, limit / np.maximum(longest, 1e-300)))
