"""What gravity does: masses of the links, torques about the axes, joints and tool that give way under them.

Weights are summed from the flange inwards, so that one vector is turned about each axis and not every link's centre.

No maker publishes them link by link. A link weighs by its length and by how far the arm reaches beyond it, since it has
to carry that; for a welding robot of 1.4 m reach this gives an upper arm of 20 kg and a forearm of 11 kg. A drive is
chosen for the moment that the arm beyond it and a rated load make; holding that, drives of this class (RV reducers in
the arm, strain wave gears in the wrist) turn by some tenths of a milliradian.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from math import cos, pi, sin
from typing import final

import numpy as np
from numpy.typing import NDArray

from sims.conditions import Payload
from sims.robot_file import RobotFile
from sims.world.errors import generator
from sims.world.kinematics import Axis, Geometry, Vector, vector

GRAVITY_M_S2 = 9.80665

Turn = tuple[float, float]
"""Cosine and sine of a joint's angle."""

KG_PER_M2 = 20.0
"""Of link, per metre of its length (and of a drive's housing) and metre of reach beyond its joint."""
HOUSING_M = 0.15
LEAST_REACH_M = 0.25
WEIGHT_SPREAD = 0.2
ALONG = (0.3, 0.5)
"""The centre of mass, as share of the way from a link's axis to the next: the drives sit at its beginning."""
ASIDE_MM = 15.0
TOOL_ALONG = (0.4, 0.6)
"""The tool's centre of mass, as share of the way from the flange to the taught TCP."""
RATED_KG_PER_M = 4.0
"""Rated load, per metre of reach; held so far before the flange and beside its axis:"""
RATED_AT_MM = (100.0, 0.0, 100.0)
WIND_UP_MRAD = (0.25, 0.6)
"""What a drive turns by under the greatest moment that it is rated for."""
_POSES = 200

AT_REST_RAD = 1e-13
_MOST_ROUNDS = 60

TOOL_COMPLIANCE = 0.00036
"""c_t = 1/(E·I) of the torch, 1/(N·m²); Wang et al. 2024, identified."""


@final
@dataclass(frozen=True, slots=True)
class Mass:
    """A weight (N) and its centre at model zero, mm, base frame."""

    weight_n: float
    centre: Vector

    def together(self, other: Mass) -> Mass:
        """Both weights, at their common centre."""
        total = self.weight_n + other.weight_n
        if total == 0.0:
            return self
        x, y, z = (
            (self.weight_n * a + other.weight_n * b) / total for a, b in zip(self.centre, other.centre, strict=True)
        )
        return Mass(total, (x, y, z))


def turns(angles: Sequence[float]) -> list[Turn]:
    """Of model angles in rad."""
    return [(cos(angle), sin(angle)) for angle in angles]


def levers(axes: Sequence[Axis], links: Sequence[Mass], turned: Sequence[Turn]) -> list[Vector]:
    """Weight times way from each axis' point to the centre of all that it carries, N·mm.

    Joints beyond the axis stand as `turned` says, it and those before it at zero.
    """
    found = []
    total = sx = sy = sz = 0.0
    for axis, link, turn in zip(reversed(axes), reversed(links), reversed(turned), strict=True):
        px, py, pz = axis.point
        cx, cy, cz = link.centre
        w = link.weight_n
        total += w
        lever = sx + w * cx - total * px, sy + w * cy - total * py, sz + w * cz - total * pz
        found.append(lever)
        x, y, z = turned_about(axis.direction, turn, lever)
        sx, sy, sz = total * px + x, total * py + y, total * pz + z
    found.reverse()
    return found


def torques(axes: Sequence[Axis], found: Sequence[Vector], turned: Sequence[Turn], down: Vector) -> list[float]:
    """Of gravity about each axis, in its sense of rotation, N·mm, at the `levers` of that pose.

    `down`: which way it pulls, a unit vector in the base frame.
    """
    out = []
    for axis, (x, y, z), (c, s) in zip(axes, found, turned, strict=True):
        down = turned_about(axis.direction, (c, -s), down)  # gravity as the link sees it
        gx, gy, gz = down
        ux, uy, uz = axis.direction
        out.append(ux * (y * gz - z * gy) + uy * (z * gx - x * gz) + uz * (x * gy - y * gx))
    return out


def turned_about(direction: Vector, turn: Turn, vector: Vector) -> Vector:
    """A vector turned about a unit direction (Rodrigues)."""
    ux, uy, uz = direction
    x, y, z = vector
    c, s = turn
    along = (1.0 - c) * (ux * x + uy * y + uz * z)
    return (
        c * x + s * (uy * z - uz * y) + along * ux,
        c * y + s * (uz * x - ux * z) + along * uy,
        c * z + s * (ux * y - uy * x) + along * uz,
    )


@final
@dataclass(frozen=True, slots=True)
class Body:
    """What gravity pulls at: a mass for each link, base first, the tool's with the last; what a joint turns by: rad
    per N·mm; the greatest moment about each axis with the rated load, N·mm."""

    links: tuple[Mass, ...]
    compliance: tuple[float, ...]
    moments: tuple[float, ...] = ()


def drawn_body(robot: RobotFile, nominal: Geometry, seed: int) -> Body:
    """Masses and stiffness of the robot `seed`; whatever else is wrong with it does not change them."""
    random = generator(seed, "compliance")
    stations = np.array([axis.point for axis in nominal.axes] + [nominal.flange[:3, 3]], dtype=float)
    links = _link_masses(stations, random)
    flange, turned = nominal.flange[:3, 3], nominal.flange[:3, :3]
    way = turned @ np.array(robot.tool.xyz, dtype=float)
    tool = Mass(robot.tool.mass * GRAVITY_M_S2, vector(flange + random.uniform(*TOOL_ALONG) * way))
    rated_kg = RATED_KG_PER_M * _reaches_m(stations)[0]
    rated = Mass(rated_kg * GRAVITY_M_S2, vector(flange + turned @ np.array(RATED_AT_MM)))
    wind_ups = 1e-3 * random.uniform(*WIND_UP_MRAD, len(links))
    moments = _greatest_moments(nominal.axes, [*links[:-1], links[-1].together(rated)], random)
    compliance = tuple(float(angle / moment) for angle, moment in zip(wind_ups, moments, strict=True))
    return Body((*links[:-1], links[-1].together(tool)), compliance, tuple(moments))


def _link_masses(stations: NDArray[np.float64], random: np.random.Generator) -> list[Mass]:
    """`stations`, (n + 1, 3): the axes' points and the flange's."""
    count = len(stations) - 1
    factors = random.uniform(1.0 - WEIGHT_SPREAD, 1.0 + WEIGHT_SPREAD, count)
    ways = np.diff(stations, axis=0)
    centres = stations[:-1] + random.uniform(*ALONG, (count, 1)) * ways + random.normal(0.0, ASIDE_MM, (count, 3))
    lengths_m = np.linalg.norm(ways, axis=1) * 1e-3
    kg = factors * KG_PER_M2 * np.maximum(_reaches_m(stations), LEAST_REACH_M) * (HOUSING_M + lengths_m)
    return [Mass(float(one) * GRAVITY_M_S2, vector(centre)) for one, centre in zip(kg, centres, strict=True)]


def _reaches_m(stations: NDArray[np.float64]) -> list[float]:
    """How far the arm stretches from each axis to the flange, m."""
    lengths = [float(np.linalg.norm(b - a)) * 1e-3 for a, b in pairwise(stations)]
    return list(accumulate(reversed(lengths)))[::-1]


def _greatest_moments(axes: Sequence[Axis], links: Sequence[Mass], random: np.random.Generator) -> list[float]:
    """N·mm: about each axis, were it level, by the weight of all that it carries, over poses drawn at random."""
    directions = np.array([axis.direction for axis in axes])
    poses = random.uniform(-pi, pi, (_POSES, len(links))).tolist()
    ways = np.array([levers(axes, links, turns(angles)) for angles in poses])
    return [float(moment) for moment in np.linalg.norm(np.cross(directions, ways), axis=2).max(axis=0)]


class Falls(ArithmeticError):
    """The drives are too soft for what they carry: there is no pose near the commanded one in which it is held."""


@final
class Compliance:
    """Sag of every joint of one robot.

    `axes`: the true ones; `tcp`: the payload's place, at model zero, mm; `scale` multiplies what joints turn by;
    `down`: which way weight pulls, a unit vector in the base frame.
    """

    def __init__(
        self, body: Body, axes: Sequence[Axis], tcp: Vector, scale: float, down: Vector = (0.0, 0.0, -1.0)
    ) -> None:
        self._axes = tuple(axes)
        self._links = body.links
        self._tcp = tcp
        self._down = down
        self.rates = tuple(scale * rate for rate in body.compliance)
        """rad per N·mm."""

    def sagged(self, angles: Sequence[float], payload_kg: float = 0.0, at: Vector | None = None) -> list[float]:
        """Model angles (rad) at rest, of drives that stand at `angles`.

        The payload is `at` this place, at model zero in the base frame, mm; None: at the TCP.

        Torques are those of the sagged pose itself: each round takes them where the round before ended, and gains
        three digits on an arm of usual stiffness. Raises Falls.
        """
        links = self._loaded(payload_kg, at or self._tcp)
        here = list(angles)
        for _ in range(_MOST_ROUNDS):
            turned = turns(here)
            pulls = torques(self._axes, levers(self._axes, links, turned), turned, self._down)
            there = [angle + rate * pull for angle, rate, pull in zip(angles, self.rates, pulls, strict=True)]
            if max(abs(a - b) for a, b in zip(here, there, strict=True)) < AT_REST_RAD:
                return there
            here = there
        raise Falls("the joints are too soft for what they carry: the arm does not come to rest")

    def _loaded(self, payload_kg: float, at: Vector) -> Sequence[Mass]:
        if not payload_kg:
            return self._links
        payload = Mass(payload_kg * GRAVITY_M_S2, at)
        return *self._links[:-1], self._links[-1].together(payload)


@final
class Bending:
    """Of a tool of this length along the flange's z (mm) and mass at its end (kg). `scale`: of the error."""

    def __init__(self, length_mm: float, mass_kg: float, scale: float) -> None:
        self._length_mm, self._scale = length_mm, scale
        self._own_mm = scale * _end_sag_mm(length_mm, mass_kg)

    def sag_mm(self, payload: Payload) -> float:
        """How far the tip sinks held level. A payload without a centre of gravity does not bend the tool."""
        if payload.at is None:
            return self._own_mm
        return self._own_mm + self._scale * sag_mm(self._length_mm, payload.at[2], payload.kg)


def sag_mm(length_mm: float, at_mm: float, mass_kg: float) -> float:
    """How far the tip of a level tool sinks by a mass at another place along it.

    A place beyond the tip is on a stiff extension of the tool; one behind the flange bends nothing.
    """
    near, far = sorted((max(length_mm, 0.0) * 1e-3, max(at_mm, 0.0) * 1e-3))
    return TOOL_COMPLIANCE * near**2 * (3.0 * far - near) / 6.0 * mass_kg * GRAVITY_M_S2 * 1e3


def _end_sag_mm(length_mm: float, mass_kg: float) -> float:
    """c_t · l³/3 · G, by a mass at the tip."""
    return TOOL_COMPLIANCE * (length_mm * 1e-3) ** 3 / 3.0 * mass_kg * GRAVITY_M_S2 * 1e3
