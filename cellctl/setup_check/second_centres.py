"""Spheres whose touches fit a second centre: the mirror image in the plane nearest to the touches.

A fit ends in one of the two, and its σ does not include the other. So each is tried, with the whole robot fitted to it.
"""

from __future__ import annotations

import numpy as np

from cellctl.calibration.estimation.estimate import Estimate, estimate
from cellctl.calibration.model.unknowns import State
from cellctl.calibration.rows import TouchRows
from cellctl.calibration.rows.row_blocks import RowBlocks
from cellctl.kinematics import Bools, Floats

AS_GOOD = 36.0
"""A second centre whose χ² is greater by at most this, six σ, may be the right one."""

APART_MM = 0.3
"""Centres nearer to each other than this are one."""

STEPS = 20
"""Steps towards a second centre, with the robot fixed, before the robot is fitted too."""


def with_best_centres(found: Estimate, rows: RowBlocks) -> tuple[Estimate, Bools]:
    """`found`, or a better fit of `rows` with other centres; and which points (S,) may also be at another place."""
    points = len(found.state.points)
    open_ = np.zeros(points, bool)
    for point in range(points):
        mirrored = _mirrored(found.state, rows, point)
        if mirrored is None:
            continue
        begin = found.deviations.copy()
        begin[found.state.of_points].reshape(-1, 3)[point] += mirrored - found.state.points[point]
        other = estimate(found.unknowns, rows.blocks, begin)
        if np.linalg.norm(other.state.points[point] - found.state.points[point]) < APART_MM:
            continue
        open_[point] = abs(other.cost - found.cost) < AS_GOOD
        found = other if other.cost < found.cost else found
    return found, open_


def _mirrored(state: State, rows: RowBlocks, point: int) -> Floats | None:
    """Place (3,) of a point on the other side of its touches; None without touches, or if the fit returns."""
    tcps, lengths = _touched(state, rows, point)
    if not len(tcps):
        return None
    away = state.points[point] - tcps.mean(axis=0)
    normal = np.linalg.svd(tcps - tcps.mean(axis=0))[2][-1]
    centre = state.points[point] - 2.0 * (away @ normal) * normal
    for _ in range(STEPS):
        between = centre - tcps
        distance = np.maximum(np.linalg.norm(between, axis=1), 1e-9)
        centre = centre - np.linalg.lstsq(between / distance[:, None], distance - lengths, rcond=1e-6)[0]
    return None if np.linalg.norm(centre - state.points[point]) < APART_MM else np.asarray(centre)


def _touched(state: State, rows: RowBlocks, point: int) -> tuple[Floats, Floats]:
    """TCPs (N, 3) at the touches of a point, and their distances (N,) from it."""
    tcps, lengths = [np.zeros((0, 3))], [np.zeros(0)]
    for block in rows.blocks:
        if isinstance(block, TouchRows):
            mine = block.point == point
            tcps.append(state.models[block.session].tcp(block.postures)[mine])
            lengths.append(block.lengths(state)[mine])
    return np.concatenate(tcps), np.concatenate(lengths)
