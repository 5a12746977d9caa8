"""Reasons for unobservable parameters with planes: missing a second plane of another direction, or a length."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from cellctl.calibration.model.unknowns import State
from cellctl.calibration.observability.other_postures import brought, thinned
from cellctl.calibration.observability.point_reasons import LENGTHLESS, lines_of_points_own
from cellctl.calibration.observability.reason import Reason, Rowed
from cellctl.calibration.rows import Measured, PlaneRows
from cellctl.calibration.rows.planes import planes_of, pole_of
from cellctl.kinematics import Bools, Floats

STEP_MM = 200.0
"""Height of the step, known exactly, that gives a plane a length."""


def of_planes(rows: Rowed) -> Iterator[Reason]:
    """A single plane, or several without a length."""
    blocks = [block for block in rows.blocks if block.of_planes]
    planes = {int(index) for block in blocks for index in np.unique(block.visited)}
    if len(planes) == 1 and len(blocks) == len(rows.blocks):
        yield Reason("all rows are on one plane", lambda: _on_other_planes(rows, *planes))
    if planes and rows.lengthless:
        yield Reason(LENGTHLESS, rows.otherwise(lambda block: _on_a_step(block, rows.state)))


def _on_a_step(block: Measured, state: State) -> Measured:
    """The rows on the plane and on a step parallel to it, in turn."""
    if not isinstance(block, PlaneRows):
        return block
    model, height = state.models[block.session], STEP_MM * (np.arange(len(block)) % 2)
    tcps = model.tcp(block.postures) + height[:, None] * block.normals(state)
    return brought(replace(block, reach=block.reach + height), model, block.q, tcps, _all_joints(block))


def _on_other_planes(rows: Rowed, plane: int) -> Floats:
    """Lines of the same rows on planes across the first one, with the planes' own places eliminated."""
    normal = planes_of(rows.state.points[plane])[0]
    found = [np.zeros((0, int(np.count_nonzero(rows.unknowns.free))))]
    blocks = [thinned(block) for block in rows.blocks]
    tcps = [rows.state.models[block.session].tcp(block.postures) for block in blocks]
    middle = np.concatenate(tcps).mean(axis=0)
    for axis in np.linalg.svd(normal[None])[2][1:]:
        turn = Rotation.from_rotvec(np.pi / 2.0 * axis)
        turned = turn.apply(normal)
        there = replace(rows.state, points=rows.state.points.copy())
        there.points[plane] = pole_of(turned, float(turned @ middle))
        moved = [
            _turned(block, there, middle + turn.apply(own - middle)) for block, own in zip(blocks, tcps, strict=True)
        ]
        found.append(lines_of_points_own(rows, there, moved, plane))
    return np.concatenate(found)


def _turned(block: Measured, state: State, tcps: Floats) -> Measured:
    return brought(block, state.models[block.session], block.q, tcps, _all_joints(block))


def _all_joints(block: Measured) -> Bools:
    return np.ones(block.q.shape[1], bool)
