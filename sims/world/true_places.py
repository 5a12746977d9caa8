"""True places beside those of the cell file: spheres, plate, reflectors, instrument, nests; certified spacings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import acos, asin, degrees
from typing import final

import numpy as np
from numpy.typing import NDArray

from sims.cell_content import Artefact, Distance, Reflectors, Station
from sims.world.errors import generator, unit_vector
from sims.world.kinematics import Matrix, Vector, pose, turn, vector

_STEPS = 50

PLATE_SHIFT_MM = 2.0
PLATE_TURN_DEG = 0.3

OFFSET_MM = 0.5
"""1 σ on each axis."""

STATION_SHIFT_MM = 10.0
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


def certified(
    rough: Mapping[str, Vector], distances: Sequence[Distance], random: np.random.Generator, scale: float
) -> NDArray[np.float64]:
    """Centres (N, 3), mm, nearest to the rough places whose distances are as certified, each ± its σ × `scale`.

    Where the distances contradict each other, they are met by weighted least squares.
    """
    rank = {name: i for i, name in enumerate(rough)}
    pairs = [tuple(rank[name] for name in distance.between) for distance in distances]
    sigmas = np.array([distance.sigma for distance in distances])
    lengths = np.array([distance.mm for distance in distances]) + scale * random.normal(0.0, sigmas)
    weights = 1.0 / np.maximum(sigmas, 1e-6)
    centres = np.array(list(rough.values()), dtype=float)
    for _ in range(_STEPS if pairs else 0):
        jacobian, spacings = _spacings(centres, pairs)
        step, *_ = np.linalg.lstsq(jacobian * weights[:, None], (lengths - spacings) * weights, rcond=None)
        centres += step.reshape(-1, 3)
        if np.abs(step).max() < 1e-9:
            break
    return centres


def _spacings(
    centres: NDArray[np.float64], pairs: Sequence[tuple[int, ...]]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    jacobian = np.zeros((len(pairs), *centres.shape))
    spacings = np.zeros(len(pairs))
    for row, (i, j) in enumerate(pairs):
        apart = centres[i] - centres[j]
        spacings[row] = np.linalg.norm(apart)
        jacobian[row, i] = apart / spacings[row]
        jacobian[row, j] = -jacobian[row, i]
    return jacobian.reshape(len(pairs), -1), spacings


@final
@dataclass(frozen=True, slots=True)
class TrueSphere:
    """A sphere and the tip that touches it: `touch_mm` is the distance TCP – sphere centre at contact."""

    id: str
    centre: Vector
    touch_mm: float


def true_spheres(artefact: Artefact, seed: int, scale: float) -> list[TrueSphere]:
    """Spacings true to their certificate (drawn with its σ), the whole moved by 2 mm and 0.3°, times `scale`."""
    random = generator(seed, "placement")
    rough = {sphere.id: sphere.centre for sphere in artefact.spheres}
    centres = certified(rough, artefact.distances, random, scale)
    if len(centres):
        middle = centres.mean(axis=0)
        rotation = turn(scale * PLATE_TURN_DEG * unit_vector(random))
        centres = (centres - middle) @ rotation.T + middle + scale * PLATE_SHIFT_MM * unit_vector(random)
    return [
        TrueSphere(sphere.id, vector(centre), sphere.diameter / 2.0 + artefact.tip_radius)
        for sphere, centre in zip(artefact.spheres, centres, strict=True)
    ]


def true_plate_z(artefact: Artefact, spheres: Sequence[TrueSphere]) -> float | None:
    """The true height of the plate: its mean distance below the spheres is the cell file's. None without a plate."""
    if artefact.plate is None or not spheres:
        return None
    raised = [true.centre[2] - rough.centre[2] for true, rough in zip(spheres, artefact.spheres, strict=True)]
    return artefact.plate.z + sum(raised) / len(raised)


@final
@dataclass(frozen=True, slots=True)
class Target:
    """A reflector: its true centre (mm) and the unit direction that it faces, base frame.

    acceptance_deg: half angle within which it reflects; constant_mm: what it truly adds to a distance.
    """

    id: str
    xyz: Vector
    facing: Vector
    acceptance_deg: float
    constant_mm: float


@final
class TrueReflectors:
    """On a stiff plate at the flange: they go with it, and not with the bending tool."""

    def __init__(self, reflectors: Reflectors, seed: int, scale: float) -> None:
        self._names = [one.id for one in reflectors.on_flange]
        self._acceptance_deg = reflectors.acceptance_deg
        rough = np.array([one.xyz for one in reflectors.on_flange], dtype=float).reshape(-1, 3)
        self._places = rough + scale * generator(seed, "reflector").normal(0.0, OFFSET_MM, rough.shape)
        facing = np.array([one.facing for one in reflectors.on_flange], dtype=float).reshape(-1, 3)
        self._facing = facing / np.linalg.norm(facing, axis=1, keepdims=True)

    def at(self, flange: Matrix, constant_mm: float) -> list[Target]:
        """With the flange at this frame, 4×4, base ← flange."""
        places = self._places @ flange[:3, :3].T + flange[:3, 3]
        facing = self._facing @ flange[:3, :3].T
        return [
            Target(name, vector(place), vector(way), self._acceptance_deg, constant_mm)
            for name, place, way in zip(self._names, places, facing, strict=True)
        ]


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
    shift, heading = scale * STATION_SHIFT_MM * unit_vector(random), scale * random.normal(0.0, HEADING_DEG)
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
