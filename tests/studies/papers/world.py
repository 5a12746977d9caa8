"""The World of a cell file, asked in this process: what a campaign on the simulated cell would measure, by computation.

The same truth, switches, scatter of the robot and noise of the instrument as over the wires; what is left out are the
wires, the way of the robot and the time. Readings are A1…An, deg (N, n); places are in the robot's base frame, mm.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Self, final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from sims.cell import SimCell, read_cell
from sims.conditions import REFERENCE_C, Conditions, Payload
from sims.geocom._accuracy import PROFILES, Profile, profile_of
from sims.world import World
from sims.world.errors import generator
from sims.world.true_places import TrueReflectors, TrueStation

Floats = NDArray[np.float64]
Ways = NDArray[np.int_]

AS_IN_CELL: Mapping[str, float] = MappingProxyType({})


@final
@dataclass(frozen=True, eq=False)
class PaperWorld:
    """One simulated robot with its instrument, if the cell has one."""

    cell: SimCell
    seed: int
    world: World

    @classmethod
    def of(
        cls, file: Path, seed: int, switches: Mapping[str, float] = AS_IN_CELL, payload: Payload | None = None
    ) -> Self:
        """switches: kinds of `simulate: errors:` → scale, on top of the cell's. payload: instead of the cell's."""
        cell = read_cell(file)
        errors = {**cell.simulate.errors, **switches}
        assert errors.keys() == cell.simulate.errors.keys(), f"unknown switch in {switches}"
        simulate = replace(cell.simulate, seed=seed, errors=errors, payload=payload or cell.simulate.payload)
        cell = replace(cell, simulate=simulate)
        return cls(cell, seed, World(cell, seed))

    def draws(self, name: str) -> np.random.Generator:
        """Random numbers of this seed for one purpose of a study."""
        return generator(self.seed, f"paper {name}")

    def points(self, readings: Floats, ways: Ways | None = None, temperature_c: float = REFERENCE_C) -> Floats:
        """The true mean TCP (N, 3). ways (N, n): sign of each joint's last motion, for the play; none: all 0."""
        given = self._conditions(readings, ways, temperature_c)
        return np.array([self.world.true_tcp(row, each) for row, each in zip(readings.tolist(), given, strict=True)])

    def flanges(self, readings: Floats, ways: Ways | None = None, temperature_c: float = REFERENCE_C) -> Floats:
        """The true mean flange (N, 4, 4)."""
        given = self._conditions(readings, ways, temperature_c)
        return np.array([self.world.true_flange(row, each) for row, each in zip(readings.tolist(), given, strict=True)])

    def reflectors(self, flanges: Floats) -> Floats:
        """The true places (N, R, 3) of the cell's reflectors on flanges (N, 4, 4)."""
        assert self.cell.reflectors
        true = TrueReflectors(self.cell.reflectors, self.seed, self.cell.simulate.errors["reflector"])
        return np.array([[target.xyz for target in true.at(flange, 0.0)] for flange in flanges])

    def scatter(self, readings: Floats, attempt: int = 0) -> Floats:
        """How far the robot is beside its mean (N, 3), mm, the `attempt`-th time it is sent there, from 0."""
        return np.array([self.world.scatter(row, attempt) for row in readings.tolist()])

    def noise(self, places: Floats, name: str, samples: int = 3) -> Floats:
        """The instrument's error (..., 3), mm, in the mean of `samples` readings of reflectors at places (..., 3).

        The part common to a reflector at one pose is drawn once. The set-up's zero and scale of distance are left out.
        """
        shape = places.shape
        flat = places.reshape(-1, 3) - self._station()
        distance = np.linalg.norm(flat, axis=1, keepdims=True)
        beam = flat / distance
        random, profile = self.draws(f"noise {name}"), self.profile
        scale = self.cell.simulate.settings["tracker"]["noise_scale"]
        across = random.normal(size=flat.shape) * _across(profile, distance, samples)
        along = random.normal(size=distance.shape) * _along(profile, distance, samples)
        across -= np.sum(across * beam, axis=1, keepdims=True) * beam
        return np.asarray(scale * (across + along * beam)).reshape(shape)

    def measured_points(
        self, readings: Floats, name: str, ways: Ways | None = None, *, reflector: int = 0, samples: int = 3
    ) -> Floats:
        """Measured places (N, 3) of one reflector, with scatter of the robot and noise of the instrument."""
        true = self.reflectors(self.flanges(readings, ways))[:, reflector] + self.scatter(readings)
        return true + self.noise(true, name, samples)

    def measured(
        self,
        readings: Floats,
        name: str,
        ways: Ways | None = None,
        *,
        samples: int = 3,
        temperature_c: float = REFERENCE_C,
    ) -> Floats:
        """Measured places (N, R, 3) of all reflectors, with scatter of the robot and noise of the instrument.

        `pose_of_plate` makes poses of three of them. name: of the noise, so that repeats have their own.
        """
        true = self.reflectors(self.flanges(readings, ways, temperature_c)) + self.scatter(readings)[:, None]
        return true + self.noise(true, name, samples)

    def currents(self, readings: Floats, ways: Ways) -> Floats:
        """Motor currents (N, n), A, at rest after motions in these directions: weight and Coulomb friction."""
        still = [0.0] * readings.shape[1]
        return np.array(
            [
                np.add(self.world.holding_currents(row), self.world.motors.friction(way, still))
                for row, way in zip(readings.tolist(), ways.tolist(), strict=True)
            ]
        )

    @property
    def profile(self) -> Profile:
        """The instrument's accuracy."""
        named = self.cell.simulate.settings["tracker"]["noise"]
        return PROFILES[named or profile_of(self.cell.addresses["tracker"])]

    def _station(self) -> Floats:
        assert self.cell.station
        errors = self.cell.simulate.errors
        station = TrueStation(self.cell.station, self.world.up, self.seed, errors["station"], 0.0)
        return np.asarray(station.frame(0)[:3, 3])

    def _conditions(self, readings: Floats, ways: Ways | None, temperature_c: float) -> list[Conditions]:
        signs: Sequence[Sequence[int]] = [()] * len(readings) if ways is None else ways.tolist()
        return [Conditions(tuple(each), temperature_c) for each in signs]


def ways_of(readings: Floats) -> Ways:
    """The sign (N, n) of each joint's last motion on a tour of these readings; of the first all 0."""
    steps = np.sign(np.diff(readings, axis=0, prepend=readings[:1])).astype(int)
    for row in range(1, len(steps)):
        still = steps[row] == 0
        steps[row, still] = steps[row - 1, still]
    return np.asarray(steps)


def plate_of(seen: Floats) -> Floats:
    """Places (R, 3) of a plate's reflectors in a frame of its own, from all its measured poses (N, R, 3).

    Origin at the first reflector, x towards the second; distances are means over the poses.
    """
    lengths = np.linalg.norm(seen[:, :, None] - seen[:, None], axis=-1).mean(axis=0)
    squares = lengths**2
    gram = (squares[:1] + squares[:, :1] - squares) / 2.0
    x = gram[:, 1] / lengths[0, 1]
    y = np.sqrt(np.maximum(squares[0] - x**2, 0.0))
    place = np.stack([x, y, np.zeros_like(x)], axis=-1)
    assert len(place) == 3, "a plate of three reflectors is expected"
    return place


def pose_of_plate(plate: Floats, seen: Floats) -> Floats:
    """The pose (4, 4) of the plate (R, 3) whose reflectors are seen at (R, 3), by least squares; mm."""
    middle, there = plate.mean(axis=0), seen.mean(axis=0)
    turn, _ = Rotation.align_vectors(seen - there, plate - middle)
    pose = np.eye(4)
    pose[:3, :3] = turn.as_matrix()
    pose[:3, 3] = there - turn.apply(middle)
    return pose


def _across(profile: Profile, distance: Floats, samples: int) -> Floats:
    common, own = (
        np.array([part.angle_rad(one) for one in distance.ravel()]) for part in (profile.common, profile.sample)
    )
    return np.asarray(np.hypot(common, own / np.sqrt(samples))[:, None] * distance)


def _along(profile: Profile, distance: Floats, samples: int) -> Floats:
    own = np.array([profile.sample.along_mm(one) for one in distance.ravel()])
    return np.asarray(own / np.sqrt(samples))[:, None]
