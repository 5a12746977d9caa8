"""Paths in joint space, within the limits, and clear of obstacles: the robot's body and what it must not touch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from cellctl.kinematics import JointMap, SerialChain, nearest_turn

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


@final
@dataclass(frozen=True, slots=True)
class Thickness:
    """Thickness of the robot, mm: radius of forearm and wrist, of the tool's shaft, and the length of the thin wire
    outside the shaft; only the wire touches.
    """

    wrist: float = 60.0
    shaft: float = 8.0
    stick_out: float = 25.0


@final
@dataclass(frozen=True, slots=True, eq=False)
class Posture:
    """Points (k, 3) on the robot's axis lines at k poses, base frame, mm; `mouth`: the shaft's end, where the wire
    begins.
    """

    elbow: Array
    wrist: Array
    flange: Array
    mouth: Array
    tip: Array


@final
class Body:
    """A robot with `thickness`; the tool is a straight shaft from flange to tip."""

    def __init__(self, chain: SerialChain, joints: JointMap, thickness: Thickness) -> None:
        self.thickness = thickness
        self._chain = chain
        self._joints = joints
        self._elbow, self._wrist = (max(1, chain.n - left) for left in (3, 2))

    def at(self, readings: Array) -> Posture:
        """Its posture at `readings` (k, n), deg, by the nominal model."""
        q = self._joints.model(readings)
        places, tip = self._chain.frames(q)[..., :3, 3], self._chain.forward(q)[:, :3, 3]
        elbow, wrist, flange = (places[:, index] for index in (self._elbow, self._wrist, -1))
        shaft = tip - flange
        length = np.linalg.norm(shaft, axis=-1, keepdims=True)
        mouth = tip - shaft * np.minimum(1.0, self.thickness.stick_out / np.maximum(length, 1e-9))
        return Posture(elbow, wrist, flange, mouth, tip)

    def tip(self, readings: Array) -> Array:
        """The tip alone, (k, 3)."""
        return np.asarray(self._chain.forward(self._joints.model(readings))[:, :3, 3])


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
        return nearest_turn(readings, first, 180.0)

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
