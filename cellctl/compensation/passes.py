"""The passes of a compensation method for many targets, each of which ends on its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from cellctl.compensation.corrections import Method, Pass
from cellctl.compensation.predictors import Predictor
from cellctl.compensation.reasons import OUT_OF_REACH, branch_reason, rest_reason, unreached_reason
from cellctl.kinematics import Bools, Floats, InverseResult, SerialChain, pose_difference

RAD_PER_MM = 1e-3
"""Tolerance of the orientation, rad, for one of 1 mm: equal at a metre from the TCP."""


_ASTRAY = 4.0
"""A pass may correct a joint by so many times the limit of the result: near a singularity the first one overshoots."""


@final
@dataclass(frozen=True, slots=True)
class Ends:
    """When the passes for a target end.

    tolerance_mm: at this distance (and `RAD_PER_MM` of it in rad); None: never. most: after so many passes. most_rad:
    the largest correction of a joint in the result.
    """

    tolerance_mm: float | None
    most: int
    most_rad: float


@final
class Passes:
    """All targets after the passes made so far.

    q (N, n), rad: commanded joints. left (N, 6), mm and rad: predicted shift and rotation vector to the target.
    history: `left` at the nominal joints and after each pass. reasons: why a target is not reached, or empty.
    """

    def __init__(
        self, sender: SerialChain, robot: Predictor, method: Method, targets: Floats, first: InverseResult
    ) -> None:
        self._sender, self._robot, self._method, self._targets, self._first = sender, robot, method, targets, first
        self._now = Pass(first.q.copy(), targets.copy(), first.converged)
        self.q = first.q.copy()
        self.left = pose_difference(targets, robot.pose(first.q + robot.zeros))
        self.history = [self.left.copy()]
        self.reasons = ["" if reached else OUT_OF_REACH for reached in first.converged.tolist()]

    def make(self, ends: Ends) -> None:
        """Make passes until every target is at its end."""
        open_ = self._first.converged & ~self._within(ends)
        for _ in range(ends.most):
            if not open_.any():
                break
            rows = np.flatnonzero(open_)
            open_[rows] = self._pass(rows, ends)
            open_ &= ~self._within(ends)
            self.history.append(self.left.copy())
        if ends.tolerance_mm is not None:
            for row in np.flatnonzero(open_).tolist():
                self.reasons[row] = self._rest(row, ends)
        change = self.q - self._first.q
        for row in np.flatnonzero(np.abs(change).max(axis=1, initial=0.0) > ends.most_rad).tolist():
            self.reasons[row] = self.reasons[row] or self._far(row, change[row], ends)

    def _pass(self, rows: np.ndarray[tuple[int, ...], np.dtype[np.intp]], ends: Ends) -> Bools:
        """One pass of the targets `rows`; which of them may have another. The nearest joints so far are kept."""
        step = self._method.correction(self._sender, self._robot, self._targets[rows], self._now.pick(rows))
        q, left = step.q - self._robot.zeros, pose_difference(self._targets[rows], self._robot.pose(step.q))
        change = q - self._first.q[rows]
        small = np.abs(change).max(axis=1) <= _ASTRAY * ends.most_rad
        good = np.asarray(step.reached & small)
        for place in np.flatnonzero(~good).tolist():
            row = int(rows[place])
            if step.reached[place]:
                self.reasons[row] = self._far(row, change[place], ends)
            else:
                self.reasons[row] = unreached_reason(self._sender, self._first.q[row], self._millimetres(row))
        self._now.q[rows[good]], self._now.pseudo[rows[good]] = step.q[good], step.pseudo[good]
        nearer = good & ((self._size(left) < self._size(self.left[rows])) | (ends.tolerance_mm is None))
        self.q[rows[nearer]], self.left[rows[nearer]] = q[nearer], left[nearer]
        return good

    def _within(self, ends: Ends) -> Bools:
        if ends.tolerance_mm is None:
            return np.zeros(len(self.left), bool)
        turned = angles(self.left) <= RAD_PER_MM * ends.tolerance_mm
        return np.asarray((distances(self.left) <= ends.tolerance_mm) & (turned | self._method.position_only))

    def _size(self, left: Floats) -> Floats:
        turned = 0.0 if self._method.position_only else angles(left) / RAD_PER_MM
        return np.asarray(distances(left) + turned)

    def _rest(self, row: int, ends: Ends) -> str:
        angle = 0.0 if self._method.position_only else float(angles(self.left[row]))
        return rest_reason(self._sender, self._first.q[row], self._millimetres(row), angle, ends.most)

    def _far(self, row: int, change: Floats, ends: Ends) -> str:
        return branch_reason(self._sender, self._first.q[row], change, ends.most_rad)

    def _millimetres(self, row: int) -> float:
        return float(distances(self.left[row]))


def distances(left: Floats) -> Floats:
    """Length (...) of the shifts of `left` (..., 6), mm."""
    return np.asarray(np.linalg.norm(left[..., :3], axis=-1))


def angles(left: Floats) -> Floats:
    """Length (...) of the rotation vectors of `left` (..., 6), rad."""
    return np.asarray(np.linalg.norm(left[..., 3:], axis=-1))
