"""Ways in joint space: within the limits, and the tool clear of the spheres, by the nominal model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from cellctl.kinematics import JointMap, SerialChain

Array = NDArray[np.float64]

_STEP_DEG = 2.0
"""How finely a way is looked at: joint degrees of the axis that moves most."""


@final
@dataclass(frozen=True, slots=True)
class Reach:
    """Joint limits of the controller's readings, degrees, shape (n,) each, with the margin to keep from them."""

    minimum: tuple[float, ...]
    maximum: tuple[float, ...]
    margin: float = 5.0


@final
class Ways:
    """Point-to-point ways of one robot with its tool among spheres.

    `spheres`: (m, 4), centre and contact radius in mm. The tool is seen as a straight shaft from flange to tip; the
    clearance to keep has to cover its thickness and the error of the nominal model.
    """

    def __init__(self, chain: SerialChain, joints: JointMap, reach: Reach, spheres: Array, clearance: float) -> None:
        self._chain = chain
        self._joints = joints
        self._low = np.array(reach.minimum) + reach.margin
        self._high = np.array(reach.maximum) - reach.margin
        self._spheres = spheres
        self._clearance = clearance

    def wrapped(self, readings: Array) -> Array:
        """`readings` (…, k, n) with whole turns taken off: the first of k nearest to zero, the others nearest to it."""
        first = (readings[..., :1, :] + 180.0) % 360.0 - 180.0
        wrapped: Array = first + (readings - first + 180.0) % 360.0 - 180.0
        return wrapped

    def within_limits(self, readings: Array) -> NDArray[np.bool_]:
        """Which rows of `readings` (…, n) keep the margin from every joint limit."""
        return np.asarray(((readings > self._low) & (readings < self._high)).all(axis=-1))

    def clear(self, start: Array, end: Array, spare: int | None = None) -> bool:
        """Does the tool keep the clearance from all spheres on the way? The tip may come nearer to sphere `spare`,
        as long as it never comes nearer to it than at the nearer end of the way.
        """
        flange, tip = self._ends(self._line(start, end))
        for index, sphere in enumerate(self._spheres):
            distance = _from_segment(sphere[:3], flange, tip) - sphere[3]
            least = min(distance[0], distance[-1]) - 0.5 if index == spare else self._clearance
            if (distance < least).any():
                return False
        return True

    def shaft_clear(self, start: Array, end: Array, touched: int) -> bool:
        """Is the tip the part of the tool nearest to the touched sphere, and the tool clear of the others?"""
        flange, tip = self._ends(self._line(start, end))
        for index, sphere in enumerate(self._spheres):
            distance = _from_segment(sphere[:3], flange, tip)
            if index == touched:
                if (distance < np.linalg.norm(tip - sphere[:3], axis=-1) - 0.5).any():
                    return False
            elif (distance - sphere[3] < self._clearance).any():
                return False
        return True

    def tip_path(self, start: Array, end: Array) -> float:
        """Length of the tip's way, mm."""
        _, tip = self._ends(np.linspace(start, end, 21))
        return float(np.linalg.norm(np.diff(tip, axis=0), axis=1).sum())

    def _line(self, start: Array, end: Array) -> Array:
        count = int(np.ceil(np.abs(end - start).max() / _STEP_DEG)) + 2
        return np.linspace(start, end, count)

    def _ends(self, readings: Array) -> tuple[Array, Array]:
        q = self._joints.model(readings)
        return self._chain.forward_flange(q)[..., :3, 3], self._chain.forward(q)[..., :3, 3]


def _from_segment(point: Array, start: Array, end: Array) -> Array:
    """Distance of `point` (3,) from the segments `start`–`end` (k, 3)."""
    along = end - start
    share = ((point - start) * along).sum(axis=-1) / (along * along).sum(axis=-1)
    nearest = start + np.clip(share, 0.0, 1.0)[..., None] * along
    distance: Array = np.linalg.norm(point - nearest, axis=-1)
    return distance
