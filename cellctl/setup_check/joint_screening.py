"""A rough screening of thousands of hypotheses about joints at once, by nominal's distances from a few rows.

For an instrument's rows base and tool are found by a linear problem in which the base may be any affine map (see
`registration`); points always have linear problems. Each is solved for all hypotheses in one batch, and a
second time on the rows that fit best.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cellctl.calibration.model.unknowns import PLACED
from cellctl.calibration.rows import Measured, PlaneRows, PoseRows, PositionRows, SocketRows, TouchRows
from cellctl.kinematics import Floats
from cellctl.setup_check.hypothesis import Setup
from cellctl.setup_check.misfit import CORE

ROWS = 40
CHUNK = 256
RIDGE = 1e-10
"""Share of the largest diagonal element: enough to solve where base and tool cannot be separated."""


def rough_sizes(setup: Setup, sign: Floats, offset: Floats) -> Floats:
    """RMS over the nearest rows (C,), mm, with joints reversed by `sign` (C, n), ±1, and changed by `offset` (C, n),
    deg.

    Uses all rows of the set-up: thin it before.
    """
    parts = [np.s_[start : start + CHUNK] for start in range(0, len(sign), CHUNK)]
    return np.concatenate([np.zeros(0), *(_sizes(setup, sign[part], offset[part]) for part in parts)])


def _sizes(setup: Setup, sign: Floats, offset: Floats) -> Floats:
    signs, offsets = sign * setup.joints.sign, offset + setup.joints.offset
    q = np.deg2rad(signs[:, None] * setup.readings + offsets[:, None])
    squares, start = [], 0
    for block in setup.task.rows.blocks:
        squares.append(_squares(setup, block, q[:, start : start + len(block)]))
        start += len(block)
    return np.asarray(np.sqrt(np.concatenate(squares, axis=1).mean(axis=1)))


def _squares(setup: Setup, block: Measured, q: Floats) -> Floats:
    """Squared distances (C, K) of a block's nearest rows."""
    chain = setup.task.model.chain
    if isinstance(block, TouchRows | SocketRows | PlaneRows):
        tcps = chain.forward(q)[..., :3, 3]
        if isinstance(block, PlaneRows):
            found = [_of_plane(tcps[:, block.point == index]) for index in np.unique(block.point)]
        elif isinstance(block, SocketRows):
            found = [_of_socket(tcps[:, block.point == index]) for index in np.unique(block.point)]
        else:
            pairs = np.column_stack([block.point, block.datum])
            groups = [(pair[1] >= 0, np.all(pairs == pair, axis=1)) for pair in np.unique(pairs, axis=0)]
            found = [_of_point(tcps[:, mine], block.reach[mine], shifted) for shifted, mine in groups]
        return _nearest(np.concatenate(found, axis=1))
    assert isinstance(block, PositionRows | PoseRows)
    if setup.task.registered != PLACED:
        return _nearest(np.sum((chain.forward(q)[..., :3, 3] - block.xyz) ** 2, axis=-1))
    return _of_instrument(chain.with_base(np.eye(4)).forward_flange(q), block.xyz)


def _of_socket(tcps: Floats) -> Floats:
    """Squared distances (C, N) from the socket that fits `tcps` (C, N, 3) best."""
    return np.asarray(np.sum((tcps - tcps.mean(axis=1, keepdims=True)) ** 2, axis=-1))


def _of_plane(tcps: Floats) -> Floats:
    """Squared distances (C, N) from the plane that fits `tcps` (C, N, 3), of balls of one size, best."""
    away = tcps - tcps.mean(axis=1, keepdims=True)
    normal = np.linalg.eigh(np.matmul(away.swapaxes(1, 2), away))[1][..., :1]
    return np.asarray(np.matmul(away, normal)[..., 0] ** 2)


def _of_point(tcps: Floats, reach: Floats, shifted: bool) -> Floats:
    """Squared distances (C, N) from the surface of the sphere that fits `tcps` (C, N, 3) best.

    shifted: its radius and `reach` (N,) differ by an unknown amount.
    """
    if tcps.shape[1] < 5 + shifted:
        return _of_socket(tcps)
    away = tcps - tcps.mean(axis=1, keepdims=True)
    unit, own = np.ones((*away.shape[:2], 1)), reach - reach.mean() if shifted else reach
    besides = [np.broadcast_to(-2.0 * own[:, None], unit.shape)] if shifted else []
    lines = np.concatenate([2.0 * away, unit, *besides], axis=-1)
    found = _solved(lines, np.sum(away**2, axis=-1) - own**2)
    length = own - found[:, 4:] if shifted else own
    return np.asarray((np.linalg.norm(away - found[:, None, :3], axis=-1) - length) ** 2)


def _of_instrument(flange: Floats, xyz: Floats) -> Floats:
    """Squared distances (C, K) of the nearest rows, base relaxed."""
    middle = xyz - xyz.mean(axis=0)
    middle = middle / max(float(np.abs(middle).max()), 1e-9)
    lines = np.zeros((*flange.shape[:2], 3, 15))
    for axis in range(3):
        lines[:, :, axis, 3 * axis : 3 * axis + 3] = middle
        lines[:, :, axis, 9 + axis] = 1.0
    lines[..., 12:] = -flange[..., :3, :3]
    right = flange[..., :3, 3]
    squares = _left(lines, right, lines, right)
    kept = np.argsort(squares, axis=1)[:, : int(np.ceil(CORE * len(xyz)))]
    near = np.take_along_axis(lines, kept[:, :, None, None], axis=1)
    return _nearest(_left(near, np.take_along_axis(right, kept[:, :, None], axis=1), lines, right))


def _left(lines: Floats, right: Floats, all_lines: Floats, all_right: Floats) -> Floats:
    """Squared residuals (C, N) of all lines for the solution from `lines`."""
    count = len(lines)
    found = _solved(lines.reshape(count, -1, 15), right.reshape(count, -1))
    left = np.matmul(all_lines, found[:, None, :, None])[..., 0] - all_right
    return np.asarray(np.sum(left**2, axis=-1))


def _solved(lines: Floats, right: Floats) -> Floats:
    """Least squares (C, k) of batches (C, M, k) and (C, M), by normal equations, slightly regularised."""
    turned = lines.swapaxes(-1, -2)
    normal = np.matmul(turned, lines)
    largest = np.diagonal(normal, axis1=-2, axis2=-1).max(axis=-1)
    held: Any = normal + RIDGE * largest[:, None, None] * np.eye(normal.shape[-1])
    return np.asarray(np.linalg.solve(held, np.matmul(turned, right[..., None]))[..., 0])


def _nearest(squares: Floats) -> Floats:
    return np.sort(squares, axis=1)[:, : int(np.ceil(CORE * squares.shape[1]))]
