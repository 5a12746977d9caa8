"""The true place of the instrument and of its nests; the instrument drifts, and may be bumped."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import acos, asin, degrees
from typing import final

import numpy as np

from sims.station_file import Station
from sims.world.certified import certified
from sims.world.errors import generator, unit_vector
from sims.world.nominal import Matrix, pose, turn, vector
from sims.world.screws import Vector

SHIFT_MM = 10.0
HEADING_DEG = 0.2
"""1 σ; at 3 m across the beam as much as SHIFT_MM."""
LEVEL_DEG = (0.005, 0.03)
"""Inclination of a levelled instrument's standing axis, from … to: 0.3 to 1.8 arc minutes."""
UPRIGHT_DEG = 3.0
"""An instrument whose rough standing axis leans less than this has been levelled by a person."""
DRIFT_MM_PER_H = 0.03
"""A steel or aluminium stand of 1.2 m that becomes 1 to 2 K warmer in an hour."""
DRIFT_DEG_PER_H = 0.0003
NEST_MM = 1.5
"""1 σ on each axis."""
_HOUR_NS = 3.6e12


@final
class TrueStation:
    """The instrument of one seed.

    `up`: opposite to gravity, unit vector in the base frame. `placement`, `drift`: scales of the errors. Frames are
    4×4, base ← instrument, mm; the instrument's z is its standing axis.
    """

    def __init__(self, station: Station, up: Vector, seed: int, placement: float, drift: float) -> None:
        self._seed = seed
        self._up = np.array(up)
        self._frame = _placed(station, self._up, seed, placement)
        random = generator(seed, "station_drift")
        self._shift_per_h = drift * DRIFT_MM_PER_H * unit_vector(random)
        self._turn_per_h = drift * DRIFT_DEG_PER_H * unit_vector(random)

    def frame(self, on_ns: int, bumps: Sequence[tuple[float, float]] = ()) -> Matrix:
        """After the cell has been on for `on_ns`, and after bumps by so many mm and degrees each."""
        hours = on_ns / _HOUR_NS
        found = _moved(self._frame, hours * self._shift_per_h, hours * self._turn_per_h)
        random = generator(self._seed, "station_bump")
        for mm, deg in bumps:
            found = _moved(found, mm * unit_vector(random), deg * unit_vector(random))
        return found

    def tilt_deg(self, frame: Matrix) -> float:
        """Angle of the standing axis of `frame` from the vertical."""
        return degrees(acos(min(1.0, float(frame[:3, 2] @ self._up))))


def true_nests(station: Station, seed: int, scale: float) -> Mapping[str, Vector]:
    """Nest → place, mm: about 1.5 mm × `scale` off the file's on each axis, with distances true to certificate."""
    random = generator(seed, "nests")
    rough = {nest.id: vector(np.array(nest.xyz) + scale * random.normal(0.0, NEST_MM, 3)) for nest in station.nests}
    centres = certified(rough, station.distances, random, scale)
    return {nest.id: vector(centre) for nest, centre in zip(station.nests, centres, strict=True)}


def _placed(station: Station, up: Matrix, seed: int, scale: float) -> Matrix:
    """The rough frame with its errors; the standing axis within arc minutes of `up`, if it is upright at all."""
    random = generator(seed, "station")
    frame = pose(station.frame.xyz, station.frame.abc)
    shift, heading = scale * SHIFT_MM * unit_vector(random), scale * random.normal(0.0, HEADING_DEG)
    tilt, across = scale * random.uniform(*LEVEL_DEG), unit_vector(random)
    leaning = np.cross(frame[:3, 2], up)
    if frame[:3, 2] @ up > np.cos(np.radians(UPRIGHT_DEG)):
        sine = float(np.linalg.norm(leaning))
        frame[:3, :3] = turn(np.degrees(leaning * (asin(sine) / sine if sine else 1.0))) @ frame[:3, :3]
    else:
        tilt = 0.0
    level = across - up * (across @ up)
    return _moved(frame, shift, tilt * level / np.linalg.norm(level)) @ pose((0.0, 0.0, 0.0), (heading, 0.0, 0.0))


def _moved(frame: Matrix, shift: Matrix, turned_deg: Matrix) -> Matrix:
    """Turned about its own origin, then shifted, in the base frame."""
    found = frame.copy()
    found[:3, :3] = turn(turned_deg) @ frame[:3, :3]
    found[:3, 3] += shift
    return found
