"""What the cell file says of a cell to simulate: its parts, and the kinds of error of the simulated cell."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, final

from sims.conditions import Payload
from sims.faults import Fault
from sims.robot_file import Frame, RobotFile, Triple

ERRORS = {
    "geometry": 1.0,
    "joint_zero": 1.0,
    "tool": 1.0,
    "deflection": 1.0,
    "repeatability": 1.0,
    "encoder": 1.0,
    "placement": 1.0,
    "servo": 1.0,
    "wear": 0.0,
    "warm_up": 0.0,
    "compliance": 0.0,
    "gear": 0.0,
    "backlash": 0.0,
    "expansion": 0.0,
    "station": 1.0,
    "reflector": 1.0,
    "station_drift": 0.0,
    "air": 0.0,
    "friction_torsion": 0.0,
}
"""The kinds of error of the simulated cell → the default scale of each."""


@final
@dataclass(frozen=True, slots=True)
class Distance:
    """A certified distance between two centres, with its 1 σ, mm."""

    between: tuple[str, str]
    mm: float
    sigma: float


@final
@dataclass(frozen=True, slots=True)
class Nest:
    """A monument nest with a reflector in it; rough place in the robot's base frame, mm."""

    id: str
    xyz: Triple


@final
@dataclass(frozen=True, slots=True)
class Station:
    """An instrument: its rough frame in the robot's base frame, its nests, certified distances between them."""

    frame: Frame
    search_mm: float = 40.0
    nests: tuple[Nest, ...] = ()
    distances: tuple[Distance, ...] = ()


@final
@dataclass(frozen=True, slots=True)
class FlangeReflector:
    """A reflector on the robot: centre (mm) and the direction that it faces (any length but 0), flange frame."""

    id: str
    xyz: Triple
    facing: Triple


@final
@dataclass(frozen=True, slots=True)
class Reflectors:
    """The reflectors on the robot. constant_mm: added to each distance; centring_mm: 1 σ.

    acceptance_deg: half angle within which they reflect.
    """

    constant_mm: float = 0.0
    centring_mm: float = 0.01
    acceptance_deg: float = 30.0
    on_flange: tuple[FlangeReflector, ...] = ()


@final
@dataclass(frozen=True, slots=True)
class Sphere:
    """A calibration sphere: diameter and rough centre in the robot's base frame, mm."""

    id: str
    diameter: float
    centre: Triple


@final
@dataclass(frozen=True, slots=True)
class Plate:
    """A horizontal plate at height `z` of the robot's base frame; the spheres' stems on it have `stem_radius`; mm."""

    z: float
    stem_radius: float


@final
@dataclass(frozen=True, slots=True)
class Artefact:
    """The objects that the tip touches; `tip_radius` in mm."""

    tip_radius: float
    spheres: tuple[Sphere, ...]
    distances: tuple[Distance, ...]
    plate: Plate | None = None


@final
@dataclass(frozen=True, slots=True)
class Simulate:
    """The `simulate:` section.

    `errors`: kind → scale, all of `ERRORS`. `payload`: what the robot truly carries; None: as the cell's `load:` says.
    `settings`: section of an installed simulator → its settings' values.
    """

    seed: int
    clock: Literal["lockstep", "realtime"]
    errors: dict[str, float]
    settings: dict[str, dict[str, Any]]
    faults: tuple[Fault, ...]
    payload: Payload | None = None


@final
@dataclass(frozen=True, slots=True)
class SimCell:
    """A cell to simulate. `addresses`: device → address as written. `home`: initial joints A1…An, deg.

    `station`, `reflectors`: of a cell with an instrument that measures reflectors. `load`: what the file says that the
    robot carries besides its tool.
    """

    path: Path
    name: str
    robot: RobotFile
    addresses: dict[str, str]
    artefact: Artefact
    simulate: Simulate
    home: tuple[float, ...] = ()
    station: Station | None = None
    reflectors: Reflectors | None = None
    load: Payload | None = None

    @property
    def payload(self) -> Payload:
        """What the robot truly carries besides its tool."""
        return self.simulate.payload or self.load or Payload()

    @property
    def folder(self) -> Path:
        """Where the cell file's paths start."""
        return self.path.parent
