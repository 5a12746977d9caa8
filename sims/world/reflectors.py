"""The true reflectors on the robot: each a little off the place that the cell file has."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from sims.station_file import Reflectors
from sims.world.errors import generator
from sims.world.nominal import Matrix, vector
from sims.world.screws import Vector

OFFSET_MM = 0.5
"""1 σ on each axis."""


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
