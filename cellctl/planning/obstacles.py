"""Obstacles of the robot: spheres, their stems, the plate below; and the distances from them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_BELOW_MM = 100.0
"""Height of the assumed plate below the lowest sphere's centre, where no plate is known."""


@final
@dataclass(frozen=True, slots=True)
class Plate:
    """A horizontal plate at height `z` of the base frame, that carries every sphere on a vertical stem; mm."""

    z: float
    stem_radius: float = 8.0

    @classmethod
    def assumed(cls, spheres: Array) -> Plate:
        """The plate to keep clear of where none is known, for `spheres` (m, 4)."""
        return cls(float(spheres[:, 2].min()) - _BELOW_MM)


@final
class Obstacles:
    """Spheres (m, 4), centre and contact radius in the base frame, mm, with their stems, on `plate`."""

    def __init__(self, spheres: Array, plate: Plate) -> None:
        feet = spheres[:, :3].copy()
        feet[:, 2] = plate.z
        self.spheres = spheres
        self._plate_z = plate.z
        self._tops = np.concatenate([spheres[:, :3], spheres[:, :3]])[:, None]
        self._feet = np.concatenate([spheres[:, :3], feet])[:, None]
        self._radii = np.concatenate([spheres[:, 3], np.full(len(spheres), plate.stem_radius)])[:, None]

    def above_plate(self, *points: Array) -> Array:
        """Height of the lowest of `points` (k, 3) each, over the plate: (k,), mm."""
        height: Array = np.min([point[:, 2] for point in points], axis=0) - self._plate_z
        return height

    def gaps(self, start: Array, end: Array) -> Array:
        """From the line `start`–`end` (k, 3) to each surface, mm: (2 m, k), first the spheres', then their stems'."""
        gaps: Array = between_lines(start, end, self._tops, self._feet) - self._radii
        return gaps


def between_lines(start: Array, end: Array, other_start: Array, other_end: Array) -> Array:
    """Least distance of the straight lines `start`–`end` and `other_start`–`other_end`, (…, 3), of any length: (…).

    Ericson, Real-Time Collision Detection, 5.1.9.
    """
    u, v, w = end - start, other_end - other_start, start - other_start
    uu, vv, uv = _dot(u, u), _dot(v, v), _dot(u, v)
    uw, vw = _dot(u, w), _dot(v, w)
    across = uu * vv - uv * uv
    share = np.clip(_ratio(uv * vw - uw * vv, across), 0.0, 1.0)
    other_share = np.clip(_ratio(uv * share + vw, vv), 0.0, 1.0)
    share = np.clip(_ratio(uv * other_share - uw, uu), 0.0, 1.0)
    distance: Array = np.linalg.norm(w + share[..., None] * u - other_share[..., None] * v, axis=-1)
    return distance


def _dot(a: Array, b: Array) -> Array:
    product: Array = (a * b).sum(axis=-1)
    return product


def _ratio(a: Array, b: Array) -> Array:
    """a / b, and 0 where b is 0: a line without length, or parallel lines."""
    a, b = np.broadcast_arrays(a, b)
    return np.divide(a, b, out=np.zeros(a.shape), where=b > 1e-9)
