"""The instrument's geometry: directions and readings in both faces, tilt, what it can see. Pure functions.

Instrument frame: right-handed, mm; x at Hz = 90°, y at Hz = 0, z along the standing axis. Hz grows clockwise seen from
above, V is counted from the zenith (protocols.md 2.3): x = D sin V sin Hz, y = D sin V cos Hz, z = D cos V.
In face 2 the same direction reads Hz + π, 2π − V.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from math import acos, atan2, cos, degrees, hypot, pi, sin, sqrt
from typing import TYPE_CHECKING, final

if TYPE_CHECKING:
    from sims.world.reflectors import Target

Vector = tuple[float, float, float]
Matrix = Sequence[Sequence[float]]

TURN = 2 * pi


@final
@dataclass(frozen=True, slots=True)
class Seen:
    """A reflector that the instrument can see. xyz: in the instrument frame.

    weak: it is turned by more than nine tenths of its acceptance, so that little light comes back.
    """

    id: str
    xyz: Vector
    constant_mm: float
    weak: bool = False

    @property
    def distance_mm(self) -> float:
        """From the instrument's centre."""
        return sqrt(sum(part * part for part in self.xyz))


@final
@dataclass(frozen=True, slots=True)
class Direction:
    """Where the telescope points, rad: the circles' readings without the instrument's errors; V > π in face 2."""

    hz: float
    v: float

    @property
    def face(self) -> int:
        """1 or 2."""
        return 1 if self.v <= pi else 2

    def other_face(self) -> Direction:
        """The same direction in the other face."""
        return Direction((self.hz + pi) % TURN, (TURN - self.v) % TURN)


@final
@dataclass(frozen=True, slots=True)
class AxisErrors:
    """The instrument's errors that the mean of two faces does not have, rad.

    collimation: the line of sight is not square to the tilting axis: c / sin V at Hz. index: the vertical circle's
    zero.
    """

    collimation: float = 0.0
    index: float = 0.0

    def reading(self, direction: Direction) -> Direction:
        """What the circles show. sin V is negative in face 2, so the collimation changes its sign."""
        sine = sin(direction.v)
        steep = abs(sine) < 1e-6
        hz = direction.hz + (0.0 if steep else self.collimation / sine)
        return Direction(hz % TURN, (direction.v + self.index) % TURN)

    def direction(self, reading: Direction) -> Direction:
        """Where the telescope points when the circles show `reading`."""
        v = (reading.v - self.index) % TURN
        sine = sin(v)
        hz = reading.hz - (0.0 if abs(sine) < 1e-6 else self.collimation / sine)
        return Direction(hz % TURN, v)


def direction_of(xyz: Vector, face: int = 1) -> Direction:
    """Towards a point of the instrument frame."""
    x, y, z = xyz
    first = Direction(atan2(x, y) % TURN, atan2(hypot(x, y), z))
    return first if face == 1 else first.other_face()


def point_at(hz: float, v: float, distance_mm: float) -> Vector:
    """The point in that direction."""
    return (distance_mm * sin(v) * sin(hz), distance_mm * sin(v) * cos(hz), distance_mm * cos(v))


def offsets(axis: Direction, xyz: Vector) -> tuple[float, float]:
    """How far a point is from the telescope's axis, rad: across horizontally, and vertically (V grows)."""
    seen = direction_of(xyz, axis.face)
    return difference(seen.hz, axis.hz) * abs(sin(seen.v)), difference(seen.v, axis.v)


def difference(one: float, other: float) -> float:
    """`one` − `other` of angles, between −π and π."""
    return (one - other + pi) % TURN - pi


def to_instrument(station: Matrix, xyz: Vector) -> Vector:
    """A point of the base frame in the instrument frame. station: 4×4, base ← instrument."""
    x, y, z = (xyz[row] - station[row][3] for row in range(3))
    first, second, third = (station[0][i] * x + station[1][i] * y + station[2][i] * z for i in range(3))
    return (first, second, third)


def tilt_of(station: Matrix, up: Vector) -> tuple[float, float]:
    """By which the standing axis leans about the instrument's x and y, rad. up: unit vector in the base frame."""
    x, y, z = (sum(station[row][i] * up[row] for row in range(3)) for i in range(3))
    sine = hypot(x, y)
    if sine == 0.0:
        return (0.0, 0.0)
    angle = atan2(sine, z)
    return (angle * y / sine, -angle * x / sine)


def levelled(tilt: tuple[float, float], xyz: Vector) -> Vector:
    """A point of the instrument frame in the frame whose z is up, turned about the instrument's centre.

    tilt: the standing axis leans by these angles about the instrument's x and y, rad; the smallest rotation that takes
    up to z.
    """
    angle = hypot(*tilt)
    if angle == 0.0:
        return xyz
    ax, ay = tilt[0] / angle, tilt[1] / angle
    x, y, z = xyz
    # Rodrigues about (ax, ay, 0)
    along = (ax * x + ay * y) * (1 - cos(angle))
    return (
        x * cos(angle) + ay * z * sin(angle) + ax * along,
        y * cos(angle) - ax * z * sin(angle) + ay * along,
        z * cos(angle) + (ax * y - ay * x) * sin(angle),
    )


def visible(
    targets: Iterable[Target],
    station: Matrix,
    tilt: tuple[float, float],
    blocked: Callable[[Vector, Vector], bool],
    wanted: Callable[[Seen], bool],
) -> tuple[Seen, ...]:
    """The wanted reflectors that face the instrument within their acceptance, and are not hidden.

    In the instrument frame, levelled by `tilt`.
    """
    centre: Vector = (station[0][3], station[1][3], station[2][3])
    found = []
    for target in targets:
        incidence = incidence_deg(target, centre)
        weak = incidence > 0.9 * target.acceptance_deg
        seen = Seen(target.id, levelled(tilt, to_instrument(station, target.xyz)), target.constant_mm, weak)
        if wanted(seen) and incidence <= target.acceptance_deg and not blocked(centre, target.xyz):
            found.append(seen)
    return tuple(found)


def incidence_deg(target: Target, centre: Vector) -> float:
    """The angle between the reflector's axis and the beam."""
    beam = [there - here for there, here in zip(centre, target.xyz, strict=True)]
    lengths = hypot(*beam) * hypot(*target.facing)
    cosine = sum(a * b for a, b in zip(beam, target.facing, strict=True)) / lengths
    return degrees(acos(max(-1.0, min(1.0, cosine))))


def nearest(seen: Iterable[Seen], axis: Direction, within_rad: float) -> Seen | None:
    """The reflector nearest to the telescope's axis, if it is within that angle of it."""
    near = [(hypot(*offsets(axis, one.xyz)), one) for one in seen]
    near = [pair for pair in near if pair[0] <= within_rad]
    return min(near, key=lambda pair: pair[0])[1] if near else None


def in_window(seen: Iterable[Seen], axis: Direction, half_hz: float, half_v: float) -> list[Seen]:
    """The reflectors within ± half_hz and ± half_v (rad, at the circles) of the telescope's axis."""
    found = []
    for one in seen:
        towards = direction_of(one.xyz, axis.face)
        if abs(difference(towards.hz, axis.hz)) <= half_hz and abs(difference(towards.v, axis.v)) <= half_v:
            found.append(one)
    return found
