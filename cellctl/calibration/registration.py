"""Where to start: base and tool in an instrument's frame, and sphere centres, from the nominal robot alone."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from cellctl.kinematics import Floats, SerialChain, pose

SETTLED_MM = 1e-3
"""Base and tool that move less than this are a start."""


def rigid_fit(points: Floats, measured: Floats) -> Floats:
    """The pose (4, 4) that carries `points` (N, 3) nearest to `measured` (N, 3) (Kabsch); right-handed always."""
    centre, there = points.mean(axis=0), measured.mean(axis=0)
    u, _, vt = np.linalg.svd((measured - there).T @ (points - centre))
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt)) or 1.0]) @ vt
    return pose(turn, there - turn @ centre)


def register_positions(
    chain: SerialChain, q: Floats, measured: Floats, *, base: bool = True, tool: bool = True, rounds: int = 30
) -> SerialChain:
    """`chain` with base and tool centre point near those that explain `measured` (N, 3), mm, at q (N, n), rad.

    Base by rigid fit and tool by least squares in turn: a start for the estimator, not a result. The tool's
    orientation is left, and so is whichever of `base` and `tool` is known.
    """
    place, offset, known = chain.base_now, chain.tool_now[:3, 3].copy(), chain.tool_now[:3, :3]
    flange = chain.with_base(np.eye(4)).forward_flange(q)
    for _ in range(rounds if base and tool else 1):
        before = offset
        if base:
            place = rigid_fit(flange[:, :3, :3] @ offset + flange[:, :3, 3], measured)
        if tool:
            wanted = (measured - place[:3, 3]) @ place[:3, :3] - flange[:, :3, 3]
            offset = np.einsum("nji,nj->ni", flange[:, :3, :3], wanted).mean(axis=0)
        if np.linalg.norm(offset - before) < SETTLED_MM:
            break
    result = chain.with_base(place) if base else chain
    return result.with_tool(pose(known, offset)) if tool else result


def turned_tool(chain: SerialChain, q: Floats, measured: Floats) -> SerialChain:
    """`chain` with its tool turned as `measured` rotations (N, 3, 3) say at q (N, n), rad."""
    flange = chain.forward_flange(q)[:, :3, :3]
    turn = Rotation.from_matrix(np.matmul(np.swapaxes(flange, -1, -2), measured)).mean().as_matrix()
    return chain.with_tool(pose(turn, chain.tool_now[:3, 3]))


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
