"""Paths in joint space: within the limits, and with only the tip near an obstacle, by the nominal model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from cellctl.planning.bodies import Body, Posture
from cellctl.planning.obstacles import Obstacles, between_lines

Array = NDArray[np.float64]

_STEP_DEG = 1.0
"""Step in which a path is checked: joint degrees of the axis that moves most."""

_WIRE_MM = 5.0
"""The least distance of the bare wire from the stem of the sphere that it touches."""

_MOUTH_MM = 4.0
"""The least distance of the tool's shaft from the sphere that its wire touches, even if the search misses it."""


@final
@dataclass(frozen=True, slots=True)
class Reach:
    """Joint limits of the controller's readings, degrees, shape (n,) each, with the margin to keep from them."""

    minimum: tuple[float, ...]
    maximum: tuple[float, ...]
    margin: float = 5.0


@final
class Ways:
    """Point-to-point paths of one robot among obstacles, with at least `clearance` (mm) between the surfaces.

    The clearance has to cover the error of the nominal model and of the spheres' places.
    """

    def __init__(self, body: Body, reach: Reach, obstacles: Obstacles, clearance: float) -> None:
        self._body = body
        self._low = np.array(reach.minimum) + reach.margin
        self._high = np.array(reach.maximum) - reach.margin
        self._obstacles = obstacles
        self._clearance = clearance

    def wrapped(self, readings: Array) -> Array:
        """`readings` (…, k, n) without whole turns: the first of k nearest to zero, the others nearest to the first."""
        first = (readings[..., :1, :] + 180.0) % 360.0 - 180.0
        wrapped: Array = first + (readings - first + 180.0) % 360.0 - 180.0
        return wrapped

    def within_limits(self, readings: Array) -> NDArray[np.bool_]:
        """Which rows of `readings` (…, n) keep the margin from every joint limit."""
        return np.asarray(((readings > self._low) & (readings < self._high)).all(axis=-1))

    def clear(self, start: Array, end: Array, touched: int | None = None) -> bool:
        """Does the robot keep the clearance from all around it on the way? The tool may come nearer to sphere
        `touched`, as long as it never comes nearer to it than at the nearer end of the way.
        """
        posture = self._body.at(_line(start, end))
        if not self._free(posture, touched):
            return False
        if touched is None:
            return True
        distance = self._to_sphere(posture, touched)
        return not bool((distance < min(distance[0], distance[-1]) - 0.5).any())

    def only_tip_touches(self, start: Array, end: Array, touched: int) -> bool:
        """Is the tip the part of the tool nearest to the touched sphere, and the robot clear of all else?"""
        posture = self._body.at(_line(start, end))
        if not self._free(posture, touched):
            return False
        tip = np.linalg.norm(posture.tip - self._obstacles.spheres[touched, :3], axis=-1)
        shaft = self._obstacles.gaps(posture.flange, posture.mouth)[touched] - self._body.thickness.shaft
        return not bool((self._to_sphere(posture, touched) < tip - 0.5).any() or (shaft < _MOUTH_MM).any())

    def tip_path(self, start: Array, end: Array) -> float:
        """Length of the tip's way, mm."""
        tip = self._body.tip(np.linspace(start, end, 21))
        return float(np.linalg.norm(np.diff(tip, axis=0), axis=1).sum())

    def _free(self, at: Posture, touched: int | None) -> bool:
        """Is there the clearance from plate, stems and spheres, but between the tool and sphere `touched`?"""
        around, thick = self._obstacles, self._body.thickness
        wrist, shaft = thick.wrist + self._clearance, thick.shaft + self._clearance
        if (around.above_plate(at.elbow, at.wrist, at.flange) < wrist).any():
            return False
        if (around.above_plate(at.mouth, at.tip) < shaft).any():
            return False
        for start, end in ((at.wrist, at.flange), (at.elbow, at.wrist)):
            if (around.gaps(start, end) < wrist).any():
                return False
        to_shaft, to_wire = around.gaps(at.flange, at.mouth) - shaft, around.gaps(at.mouth, at.tip) - shaft
        if touched is not None:
            to_shaft[touched] = to_wire[touched] = 0.0
            to_wire[touched + len(around.spheres)] += shaft - _WIRE_MM
        return bool(to_shaft.min() >= 0.0 and to_wire.min() >= 0.0)

    def _to_sphere(self, at: Posture, touched: int) -> Array:
        """From the whole tool's line to the sphere's centre, mm, (k,)."""
        centre = self._obstacles.spheres[touched, :3]
        return between_lines(at.flange, at.tip, centre, centre)


def _line(start: Array, end: Array) -> Array:
    count = int(np.ceil(np.abs(end - start).max() / _STEP_DEG)) + 2
    return np.linspace(start, end, count)
