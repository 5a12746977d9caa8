"""What the instrument sees: directions and readings in both faces, tilt, air, targets of the scene and their faults.

Leica TM30/TS30 User Manual, p. 76, visible red laser; reference atmosphere 12 °C, 1013.25 hPa, 60 %:
ppm = 286.34 − (0.29525 p − 4.126e-4 · h · 10^x) / (1 + t / 273.15), x = 7.5 t / (237.3 + t) + 0.7857.

Instrument frame: right-handed, mm; x at Hz = 90°, y at Hz = 0, z along the standing axis. Hz grows clockwise seen from
above, V is counted from the zenith (protocols.md 2.3): x = D sin V sin Hz, y = D sin V cos Hz, z = D cos V.
In face 2 the same direction reads Hz + π, 2π − V.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from math import acos, atan2, cos, degrees, hypot, pi, radians, sin, sqrt
from typing import TYPE_CHECKING, final

from sims.faults import Faults
from sims.scene.scene import Scene

if TYPE_CHECKING:
    from sims.world.true_places import Target


def saturation_hpa(air_c: float) -> float:
    """Pressure of saturated water vapour over water (Magnus), hPa; the manual's 10^x."""
    return float(10 ** (7.5 * air_c / (237.3 + air_c) + 0.7857))


def ppm_of_air(air_c: float, pressure_hpa: float, vapour_hpa: float) -> float:
    """Part of a distance, in millionths, that must be added to what the instrument measures in this air."""
    return 286.34 - (0.29525 * pressure_hpa - 4.126e-2 * vapour_hpa) / (1 + air_c / 273.15)


def vapour_of_humidity(air_c: float, humidity_percent: float) -> float:
    """Partial pressure of water vapour, hPa."""
    return humidity_percent / 100 * saturation_hpa(air_c)


def vapour_of_wet_bulb(dry_c: float, wet_c: float, pressure_hpa: float) -> float:
    """Partial pressure of water vapour from a psychrometer (Sprung), hPa; never below 0."""
    return max(0.0, saturation_hpa(wet_c) - 6.62e-4 * pressure_hpa * (dry_c - wet_c))


def measured_mm(
    true_mm: float, *, ppm_set: float, ppm_true: float, constant_set_mm: float, constant_true_mm: float
) -> float:
    """The distance that the instrument shows: right where air and constant are set as they are.

    The light travels `true_mm` less the reflector's constant, at the air's true speed.
    """
    return (true_mm - constant_true_mm) * (1 + (ppm_set - ppm_true) * 1e-6) + constant_set_mm


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


COMPENSATOR_RAD = radians(4 / 60)
"""The compensator's range: ± 4′."""

GROSS_TILT_RAD = radians(1.0)
"""The instrument refuses to measure beyond this tilt."""


@final
class Sight:
    """The reflectors in the instrument's frame, levelled where the compensator does it, at the present moment.

    lost: reflectors that are gone (fault `tracker.reflector_lost`).
    """

    def __init__(self, scene: Scene, faults: Faults) -> None:
        self._scene = scene
        self._faults = faults
        self.lost: set[str] = set()

    def targets(self, *, compensated: bool, wanted: Callable[[Seen], bool] = lambda seen: True) -> tuple[Seen, ...]:
        """The wanted reflectors that can be seen now."""
        if self._faults.active("tracker.beam_broken"):
            return ()
        scene, tilt = self._scene, self.tilt if compensated and self.compensator_works else (0.0, 0.0)
        return visible(
            scene.reflectors(),
            self._station(),
            tilt,
            scene.blocked,
            lambda seen: seen.id not in self.lost and wanted(seen),
        )

    def with_second(self, seen: tuple[Seen, ...], axis: Direction) -> tuple[Seen, ...]:
        """And a reflection beside the reflector nearest to the axis, while the fault is active."""
        fault = self._faults.active("tracker.second_target")
        first = nearest(seen, axis, radians(10))
        if fault is None or first is None:
            return seen
        x, y, z = first.xyz
        across = fault.settings["beside_mm"] / max(hypot(x, y), 1.0)
        return (*seen, replace(first, id=f"{first.id} second", xyz=(x + y * across, y - x * across, z)))

    @property
    def compensator_works(self) -> bool:
        """Whether the tilt is in the compensator's range."""
        return max(map(abs, self.tilt)) <= COMPENSATOR_RAD

    @property
    def grossly_tilted(self) -> bool:
        """Whether nothing can be measured at all."""
        return hypot(*self.tilt) > GROSS_TILT_RAD

    @property
    def tilt(self) -> tuple[float, float]:
        """By which the standing axis leans, about the instrument's x and y, rad."""
        fault = self._faults.active("tracker.tilt")
        about_x, about_y = tilt_of(self._station(), self._scene.world.up)
        return (about_x + radians(fault.settings["arcmin"] / 60), about_y) if fault else (about_x, about_y)

    def ppm(self) -> float:
        """The atmospheric correction that the true air needs."""
        true = self._scene.environment()
        vapour = vapour_of_humidity(true.air_c, true.humidity_percent)
        return ppm_of_air(true.air_c, true.pressure_hpa, vapour)

    def air_c(self) -> float:
        """Temperature of the air."""
        return self._scene.environment().air_c

    def pose(self) -> str:
        """What the robot has been commanded to, and how often: the key of the noise."""
        arm = self._scene.arm
        return ",".join(f"{joint:.4f}" for joint in arm.commanded) + f" {arm.attempt}"

    def changes(self) -> tuple[bool, bool, int]:
        """Whether the arm moves, the beam is broken, and how many reflectors are lost: the reasons to look again."""
        broken = self._faults.active("tracker.beam_broken") is not None
        return (self._scene.arm.moving, broken, len(self.lost))

    def _station(self) -> Matrix:
        found: list[list[float]] = self._scene.station().tolist()
        return found
