"""How heavy the links of this one robot are, and how stiff its drives: figures by size, as robots of its class have.

No maker publishes them link by link. A link weighs by its length and by how far the arm reaches beyond it, since it has
to carry that; for a welding robot of 1.4 m reach this gives an upper arm of 20 kg and a forearm of 11 kg. A drive is
chosen for the moment that the arm beyond it and a rated load make; holding that, drives of this class (RV reducers in
the arm, strain wave gears in the wrist) turn by some tenths of a milliradian.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from math import pi
from typing import final

import numpy as np
from numpy.typing import NDArray

from sims.robot_file import RobotFile
from sims.world.errors import generator
from sims.world.nominal import Geometry, vector
from sims.world.screws import Axis
from sims.world.statics import GRAVITY_M_S2, Mass, levers, turns

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
    moments = [
        np.linalg.norm(np.cross(directions, levers(axes, links, turns(angles))), axis=1)
        for angles in random.uniform(-pi, pi, (_POSES, len(links))).tolist()
    ]
    return [float(moment) for moment in np.max(moments, axis=0)]
