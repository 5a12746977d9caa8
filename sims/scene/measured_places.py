"""What an instrument measures and where it is: true reflectors, nests and station, with the faults of these."""

from __future__ import annotations

from collections.abc import Mapping
from math import dist
from typing import Any, final

from sims.cell import SimCell
from sims.faults import Faults
from sims.memory import Memory
from sims.scene.faults import REFLECTOR_WRONG, STATION_BUMP
from sims.station_file import Reflectors
from sims.world.nominal import Matrix, vector
from sims.world.reflectors import Target, TrueReflectors
from sims.world.screws import Vector
from sims.world.station import TrueStation, true_nests


@final
class MeasuredPlaces:
    """Of one cell. Times are `on_ns`: how long the cell has been on. Bumps of the station are kept in `memory`."""

    def __init__(self, cell: SimCell, up: Vector, faults: Faults, memory: Memory) -> None:
        seed, errors = cell.simulate.seed, cell.simulate.errors
        self._faults, self._memory = faults, memory
        self._bumps: list[tuple[float, float]] = memory.recall("station", _bumps) or []
        self._file = cell.reflectors or Reflectors()
        self._on_robot = TrueReflectors(self._file, seed, errors["reflector"])
        self._station: TrueStation | None = None
        self._nests: Mapping[str, Vector] = {}
        if cell.station:
            self._station = TrueStation(cell.station, up, seed, errors["station"], errors["station_drift"])
            self._nests = true_nests(cell.station, seed, errors["station"])
            memory.keep("station", lambda: {"bumps": self._bumps})
        faults.on_start(STATION_BUMP.name, self._bump)

    def station(self, on_ns: int) -> Matrix:
        """The instrument's frame, 4×4, base ← instrument, mm. Raises LookupError."""
        return self._placed().frame(on_ns, self._bumps)

    def tilt(self, on_ns: int) -> float:
        """Inclination of its standing axis from the vertical, degrees. Raises LookupError."""
        return self._placed().tilt_deg(self.station(on_ns))

    def reflectors(self, flange: Matrix, on_ns: int) -> tuple[Target, ...]:
        """Those on the robot, with the flange at this frame (4×4, base ← flange), then those in the nests."""
        wrong = self._faults.active(REFLECTOR_WRONG.name)
        constant_mm = self._file.constant_mm + (wrong.settings["mm"] if wrong else 0.0)
        on_robot = self._on_robot.at(flange, constant_mm)
        if not self._nests:
            return tuple(on_robot)
        station = vector(self.station(on_ns)[:3, 3])
        acceptance_deg = self._file.acceptance_deg
        nests = [
            Target(name, place, _towards(place, station), acceptance_deg, constant_mm)
            for name, place in self._nests.items()
        ]
        return *on_robot, *nests

    def _placed(self) -> TrueStation:
        if self._station is None:
            raise LookupError("the cell file has no section `station:`: write there where the instrument is")
        return self._station

    def _bump(self) -> None:
        fault = self._faults.active(STATION_BUMP.name)
        if fault and self._station:
            self._bumps.append((fault.settings["mm"], fault.settings["deg"]))
            self._memory.save()


def _bumps(state: Mapping[str, Any]) -> list[tuple[float, float]]:
    return [(float(mm), float(deg)) for mm, deg in state["bumps"]]


def _towards(place: Vector, other: Vector) -> Vector:
    """The unit direction from a place to another."""
    length = dist(place, other) or 1.0
    x, y, z = ((b - a) / length for a, b in zip(place, other, strict=True))
    return x, y, z
