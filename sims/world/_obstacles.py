"""What stands in the robot's way besides the tip's contact: spheres, stems and plate against tool, wrist and forearm.

In plain floats, because it is asked for on every stretch of every motion that comes near to something.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import dist, sqrt
from typing import final

from sims.world.kinematics import Vector

WRIST_MM = 60.0
"""Radius of forearm and wrist, from elbow to flange."""
SHAFT_MM = 5.0
"""Radius of the torch's contact tube; the wire, which touches, stands out of it bare."""
STICK_OUT_MM = 25.0
PLATE_EDGE_MM = 100.0
_ROUNDING_MM = 1e-6


@final
class Obstacles:
    """Spheres as (centre, radius) on stems of `stem_radius` straight down to a plate at height `plate_z`, all in mm.

    Without a plate (None) the spheres hang in the air.
    """

    def __init__(self, spheres: Sequence[tuple[Vector, float]], plate_z: float | None, stem_radius: float) -> None:
        self._spheres = tuple(spheres)
        self._plate_z = plate_z
        self._stem_radius = stem_radius
        feet = [] if plate_z is None else [((x, y, plate_z), (x, y, z)) for (x, y, z), _ in self._spheres]
        self._stems = [(foot, head, _middle(foot, head), dist(foot, head) / 2.0) for foot, head in feet]

    def gap(self, elbow: Vector, wrist: Vector, flange: Vector, tip: Vector) -> float:
        """Least distance of the robot from anything, mm, negative where they overlap; the wire may touch spheres."""
        bodies = _bodies(elbow, wrist, flange, tip)
        mouth = bodies[-1][1]
        gap = float("inf")
        for a, b, radius in (*bodies, (mouth, tip, 0.0)):
            gap = min(gap, self._to_stand(a, b, gap + radius) - radius)
        for centre, size in self._spheres:
            gap = min(gap, *[_from_line(centre, a, b) - radius - size for a, b, radius in bodies])
        return gap

    def between(self, start: Vector, end: Vector, elbow: Vector, wrist: Vector, flange: Vector, tip: Vector) -> bool:
        """Does the line from `start` to `end` meet a sphere, a stem, the plate, or the robot's bodies?

        The plate reaches `PLATE_EDGE_MM` beyond the outermost stems, as far as beams are concerned.
        """
        if any(_apart(start, end, a, b) < radius for a, b, radius in _bodies(elbow, wrist, flange, tip)):
            return True
        if any(_from_line(centre, start, end) < size for centre, size in self._spheres):
            return True
        plate_z = self._plate_z
        if plate_z is None:
            return False
        return self._meets_plate(start, end, plate_z) or any(
            _apart(start, end, foot, head) < self._stem_radius for foot, head, *_ in self._stems
        )

    def _meets_plate(self, start: Vector, end: Vector, plate_z: float) -> bool:
        if (start[2] - plate_z) * (end[2] - plate_z) >= 0.0:
            return False
        share = (plate_z - start[2]) / (end[2] - start[2])
        place = [a + share * (b - a) for a, b in zip(start[:2], end[:2], strict=True)]
        ways = zip(place, zip(*(centre[:2] for centre, _ in self._spheres), strict=True), strict=True)
        return all(min(stems) - PLATE_EDGE_MM < at < max(stems) + PLATE_EDGE_MM for at, stems in ways)

    def _to_stand(self, a: Vector, b: Vector, most: float) -> float:
        """From the line a–b to plate and stems, where that is less than `most`; else any greater distance.

        Two lines are no nearer than their middles less half their lengths: for most stems that is enough to know.
        """
        if self._plate_z is None:
            return float("inf")
        gap = min(a[2], b[2]) - self._plate_z
        middle, half = _middle(a, b), dist(a, b) / 2.0 + self._stem_radius + _ROUNDING_MM
        for foot, head, stem_middle, stem_half in self._stems:
            if dist(middle, stem_middle) - half - stem_half < min(gap, most):
                gap = min(gap, _apart(a, b, foot, head) - self._stem_radius)
        return gap


def _bodies(elbow: Vector, wrist: Vector, flange: Vector, tip: Vector) -> tuple[tuple[Vector, Vector, float], ...]:
    """Forearm, wrist and the tool's tube: each round, by its line's ends and its radius."""
    mouth = _towards(tip, flange, STICK_OUT_MM)
    return (elbow, wrist, WRIST_MM), (wrist, flange, WRIST_MM), (flange, mouth, SHAFT_MM)


def _middle(a: Vector, b: Vector) -> Vector:
    return (a[0] + b[0]) / 2.0, (a[1] + b[1]) / 2.0, (a[2] + b[2]) / 2.0


def _towards(start: Vector, end: Vector, way: float) -> Vector:
    share = way / max(dist(start, end), way)
    x, y, z = (a + share * (b - a) for a, b in zip(start, end, strict=True))
    return x, y, z


def _apart(a: Vector, b: Vector, c: Vector, d: Vector) -> float:
    """Least distance between the lines a–b and c–d: of the four ends from the other line, and between the insides."""
    ends = (_from_line(a, c, d), _from_line(b, c, d), _from_line(c, a, b), _from_line(d, a, b))
    return min(*ends, _inside(a, b, c, d))


def _from_line(p: Vector, a: Vector, b: Vector) -> float:
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    wx, wy, wz = p[0] - a[0], p[1] - a[1], p[2] - a[2]
    length = ux * ux + uy * uy + uz * uz
    share = min(1.0, max(0.0, (wx * ux + wy * uy + wz * uz) / length)) if length else 0.0
    return sqrt((wx - share * ux) ** 2 + (wy - share * uy) ** 2 + (wz - share * uz) ** 2)


def _inside(a: Vector, b: Vector, c: Vector, d: Vector) -> float:
    """Distance of the two infinite lines where their nearest points lie within both pieces; else infinity."""
    u = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    v = d[0] - c[0], d[1] - c[1], d[2] - c[2]
    w = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    n = _cross(u, v)
    square = _dot(n, n)
    if square < 1e-12:
        return float("inf")
    along_u, along_v = _dot(_cross(w, v), n) / square, _dot(_cross(w, u), n) / square
    if not (0.0 <= along_u <= 1.0 and 0.0 <= along_v <= 1.0):
        return float("inf")
    return abs(_dot(w, n)) / sqrt(square)


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
