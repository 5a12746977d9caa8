"""Where to start: base and tool in an instrument's frame, and sphere centres, from the nominal robot alone."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from cellctl.kinematics import Floats, SerialChain, pose


def rigid_fit(points: Floats, measured: Floats) -> Floats:
    """The pose (4, 4) that carries `points` (N, 3) nearest to `measured` (N, 3) (Kabsch); right-handed always."""
    centre, there = points.mean(axis=0), measured.mean(axis=0)
    u, _, vt = np.linalg.svd((measured - there).T @ (points - centre))
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt)) or 1.0]) @ vt
    return pose(turn, there - turn @ centre)


def register_positions(chain: SerialChain, q: Floats, measured: Floats, rounds: int = 30) -> SerialChain:
    """`chain` with base and tool centre point near those that explain `measured` (N, 3), mm, at q (N, n), rad.

    Base by rigid fit and tool by least squares in turn: a start for the estimator, not a result. The tool's
    orientation is left.
    """
    bare = chain.with_base(np.eye(4))
    flange, offset = bare.forward_flange(q), chain.tool_now[:3, 3].copy()
    base = np.eye(4)
    for _ in range(rounds):
        base = rigid_fit(flange[:, :3, :3] @ offset + flange[:, :3, 3], measured)
        wanted = (measured - base[:3, 3]) @ base[:3, :3] - flange[:, :3, 3]
        local = np.einsum("nji,nj->ni", flange[:, :3, :3], wanted)
        offset = local.mean(axis=0)
    return chain.with_base(base).with_tool(pose(chain.tool_now[:3, :3], offset))


def register_poses(chain: SerialChain, q: Floats, measured: Floats) -> SerialChain:
    """`chain` with base and tool near those that explain `measured` poses (N, 4, 4), mm, at q (N, n), rad."""
    placed = register_positions(chain, q, measured[:, :3, 3])
    flange = placed.forward_flange(q)[:, :3, :3]
    turns = np.matmul(np.swapaxes(flange, -1, -2), measured[:, :3, :3])
    turn = Rotation.from_matrix(turns).mean().as_matrix()
    return placed.with_tool(pose(turn, placed.tool_now[:3, 3]))


def sphere_centre(tips: Floats, reach: Any) -> Floats:
    """Centre (3,) of the sphere of radius `reach` (N,), mm, whose surface the points `tips` (N, 3) lie nearest to.

    Linear least squares of |p|² − ρ² = 2 p·c + k about the points' mean: a start for the estimator. Fewer than four
    points give the nearest to the mean that they allow.
    """
    mean = tips.mean(axis=0)
    away = tips - mean
    rows = np.concatenate([2.0 * away, np.ones((len(tips), 1))], axis=1)
    right = np.sum(away**2, axis=1) - np.asarray(reach, float) ** 2
    return np.asarray(mean + np.linalg.lstsq(rows, right, rcond=1e-6)[0][:3])
