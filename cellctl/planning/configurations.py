"""Inverse kinematics for many poses of one region, in one configuration of the arm, within the joint limits."""

from __future__ import annotations

from typing import Self, final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from cellctl.kinematics import JointMap, SerialChain, inverse, rotation_vector

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_STARTS, _PROBES, _TRIED = 64, 24, 8
_TOLERANCE_MM, _TOLERANCE_RAD = 1e-6, 1e-9


@final
class Configuration:
    """A posture of the arm (n,), deg, from which the inverse starts, so that all targets have the same configuration.

    low, high (n,): the readings allowed, deg. A pose that Newton's steps do not reach from the posture is tried once
    more, from the nearest pose that was reached.
    """

    def __init__(self, chain: SerialChain, joints: JointMap, low: Array, high: Array, near: Array) -> None:
        self._chain, self._joints, self._low, self._high = chain, joints, low, high
        self.near = near

    @classmethod
    def suiting(
        cls, chain: SerialChain, joints: JointMap, low: Array, high: Array, poses: Array, rng: np.random.Generator
    ) -> Self | None:
        """The configuration in which most of `poses` (N, 4, 4) are reached; None where none of them is reached.

        Candidates: solutions of the first poses from starts spread over the joints. Of equal ones, the one nearest to
        the middle of the limits, in shares of their width.
        """
        probes = poses[:_PROBES]
        spread = low + qmc.Sobol(len(low), rng=rng).random(_STARTS) * (high - low)
        found = cls(chain, joints, low, high, (low + high) / 2.0)._solved(probes[None, :4], spread[:, None])
        flat, inside = found[0].reshape(-1, len(low)), found[1].reshape(-1)
        candidates = flat[inside]
        if not len(candidates):
            return None
        from_middle = (candidates - (low + high) / 2.0) / np.maximum(high - low, 1e-9)
        best = np.argsort(np.sum(from_middle**2, axis=1), kind="stable")
        different = [best[0]]
        for place in best[1:]:
            if len(different) < _TRIED and _apart(candidates[place], candidates[different]):
                different.append(place)
        tried = [cls(chain, joints, low, high, candidates[place]) for place in different]
        counts = [int(np.count_nonzero(each.readings(probes)[1])) for each in tried]
        return tried[int(np.argmax(counts))]

    def readings(self, poses: Array) -> tuple[Array, Mask, Mask]:
        """Readings (N, n), deg, at which the TCP is at `poses` (N, 4, 4); which (N,) are usable; which of the others
        are reached, but only beyond the limits.
        """
        readings, inside, reached = self._solved(poses, self.near)
        again = np.flatnonzero(~inside)
        if inside.any() and again.size:
            start = readings[inside][_nearest(poses[again], poses[inside], self._chain.reach_mm)]
            other, other_inside, other_reached = self._solved(poses[again], start)
            better = other_inside | (other_reached & ~reached[again])
            readings[again[better]] = other[better]
            inside[again], reached[again] = other_inside, reached[again] | other_reached
        return readings, inside, reached & ~inside

    def _solved(self, poses: Array, start: Array) -> tuple[Array, Mask, Mask]:
        found = inverse(
            self._chain, poses, self._joints.model(start), tolerance_mm=_TOLERANCE_MM, tolerance_rad=_TOLERANCE_RAD
        )
        readings = self._joints.readings(found.q)
        readings = self.near + (readings - self.near + 180.0) % 360.0 - 180.0
        readings = readings - 360.0 * (readings > self._high) * (readings - 360.0 >= self._low)
        readings = readings + 360.0 * (readings < self._low) * (readings + 360.0 <= self._high)
        within = ((readings >= self._low) & (readings <= self._high)).all(axis=-1)
        return readings, found.converged & within, found.converged


def _apart(one: Array, others: Array) -> bool:
    """Whether a posture (n,) is of another configuration than `others` (m, n): some joint differs by more than 45°."""
    return bool((np.abs(others - one).max(axis=1) > 45.0).all())


def _nearest(poses: Array, known: Array, reach: float) -> NDArray[np.int_]:
    """Index (N,) of the nearest of `known` (K, 4, 4): distance, and rotation times the arm's reach."""
    best = np.zeros(len(poses), int)
    for place, each in enumerate(poses):
        away = np.linalg.norm(known[:, :3, 3] - each[:3, 3], axis=1)
        turn = np.linalg.norm(rotation_vector(known[:, :3, :3] @ each[:3, :3].T), axis=1)
        best[place] = int(np.argmin(away + reach * turn))
    return best
