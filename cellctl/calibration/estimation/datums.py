"""Instruments that measure lengths from an unknown zero: start values of that zero and of the points measured to.

A draw-wire counts from where it was switched on; a ball-bar without its calibration piece measures changes of length:
each shows ℓ = |p − a| + z. Squared, |p − a|² = (ℓ − z)² is linear in the point a, the zero z and, once for each point,
|a|² − z².
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np

from cellctl.calibration.model.unknowns import State
from cellctl.calibration.rows import Measured, TouchRows
from cellctl.kinematics import Floats

EVEN = 1000.0
"""Scale between mm and mm², so that the columns of both have similar size."""


def with_datums(state: State, blocks: Sequence[Measured]) -> State:
    """`state` with start values from `blocks`: its datums, and the points that only instruments without a zero
    measured to. All other points stay as in `state`.
    """
    points, datums = state.points.copy(), state.datums.copy()
    known = np.array([any(block.telling(point).any() for block in blocks) for point in range(len(points))])
    for index in range(len(datums)):
        rows = _Lengths.of(state, blocks, index)
        if not len(rows.shown):
            continue
        at_known = known[rows.point]
        if at_known.any():
            datums[index] = np.median(rows.beyond(points)[at_known])
        else:
            datums[index] = rows.datum(points)
        for point in np.unique(rows.point[~at_known]):
            points[point] = rows.place(point, points[point], datums[index])
            known[point] = True
    return replace(state, points=points, datums=datums)


@final
@dataclass(frozen=True, eq=False)
class _Lengths:
    """What one instrument showed (N,), mm, with the tool at TCPs (N, 3), to the points of index point (N,)."""

    tcps: Floats
    shown: Floats
    point: Any

    @classmethod
    def of(cls, state: State, blocks: Sequence[Measured], datum: int) -> _Lengths:
        """Those of the instrument of number `datum`."""
        tcps, shown, point = [np.zeros((0, 3))], [np.zeros(0)], [np.zeros(0, int)]
        for block in blocks:
            if isinstance(block, TouchRows) and np.any(mine := block.datum == datum):
                tcps.append(state.models[block.session].tcp(block.postures.pick(mine)))
                shown.append(block.reach[mine])
                point.append(block.point[mine])
        return cls(np.concatenate(tcps), np.concatenate(shown), np.concatenate(point))

    def beyond(self, points: Floats) -> Floats:
        """Its readings minus the distances from `points` (S, 3): (N,), mm."""
        return np.asarray(self.shown - np.linalg.norm(self.tcps - points[self.point], axis=-1))

    def datum(self, points: Floats) -> float:
        """Its reading at length 0, with free points; where the rows leave it open, near `points` (S, 3) and 0."""
        lines, right = self._linear(points)
        return float(min(_solved(np.column_stack([lines, -2.0 * self.shown]), right)[-1], self.shown.min()))

    def place(self, point: int, near: Floats, datum: float) -> Floats:
        """Place (3,) that fits the rows of `point` best with `datum` known; where they leave it open, `near`."""
        mine = self.point == point
        alone = _Lengths(self.tcps[mine], self.shown[mine] - datum, np.zeros(np.count_nonzero(mine), int))
        return np.asarray(near + _solved(*alone._linear(near[None]))[:3])

    def _linear(self, points: Floats) -> tuple[Floats, Floats]:
        """Lines (N, 4 U) and right side (N,), mm²: the steps of its U points from `points` (S, 3), mm, and
        the constants, `EVEN` mm² each.
        """
        there, number = np.unique(self.point, return_inverse=True)
        away, each = self.tcps - points[self.point], np.arange(len(self.shown))
        lines = np.zeros((len(self.shown), len(there), 4))
        lines[each, number, :3], lines[each, number, 3] = 2.0 * away, EVEN
        return lines.reshape(len(self.shown), -1), np.sum(away**2, axis=1) - self.shown**2


def _solved(lines: Floats, right: Floats) -> Floats:
    return np.asarray(np.linalg.lstsq(lines, right, rcond=1e-6)[0])
