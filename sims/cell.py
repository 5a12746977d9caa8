"""The cell file, as far as its simulators need it. A reader of its own: `cellctl` has another."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, final
from urllib.parse import parse_qs, urlsplit

import yaml

from sims.faults import FaultError, FaultSetting, read_fault
from sims.robot_file import RobotFile, Triple, read_robot
from sims.section import Section

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
}
"""The kinds of error of the simulated cell → the scale of each, unless the cell file says otherwise."""


class CellError(Exception):
    """The cell cannot be simulated as its files stand; the text is one block that names every mistake."""

    def __init__(self, path: Path, problems: list[str]) -> None:
        self.problems = problems
        super().__init__("\n".join([f"{path}: this cell cannot be simulated", *(f"  {text}" for text in problems)]))


@final
@dataclass(frozen=True, slots=True)
class Sphere:
    """A calibration sphere: diameter and rough centre in the robot's base frame, mm."""

    id: str
    diameter: float
    centre: Triple


@final
@dataclass(frozen=True, slots=True)
class Distance:
    """A certified distance between two spheres' centres, with its 1 σ, mm."""

    between: tuple[str, str]
    mm: float
    sigma: float


@final
@dataclass(frozen=True, slots=True)
class Plate:
    """A horizontal plate at height `z` of the robot's base frame; the spheres' stems on it have `stem_radius`; mm."""

    z: float
    stem_radius: float


@final
@dataclass(frozen=True, slots=True)
class Artefact:
    """What the tip touches; `tip_radius` in mm."""

    tip_radius: float
    spheres: tuple[Sphere, ...]
    distances: tuple[Distance, ...]
    plate: Plate | None = None


@final
@dataclass(frozen=True, slots=True)
class RsiSettings:
    """Interpolation cycle, decimals of the telegram, tolerated late cycles, and how they count (total, or reset).

    `mode`: what the controller's program passes to RSI_ON, absolute or relative.
    """

    cycle_ms: int
    precision: int
    timeout_cycles: int
    counter: str
    mode: str


@final
@dataclass(frozen=True, slots=True)
class ProbeSettings:
    """Grid of the USB polls, ms (0: none), and the further edges of a contact that bounces."""

    usb_delay_ms: float
    bounce: int


@final
@dataclass(frozen=True, slots=True)
class Simulate:
    """The `simulate:` section. `errors`: kind → scale, all of `ERRORS`."""

    seed: int
    clock: Literal["lockstep", "realtime"]
    errors: dict[str, float]
    rsi: RsiSettings
    probe: ProbeSettings
    faults: tuple[FaultSetting, ...]


@final
@dataclass(frozen=True, slots=True)
class SimCell:
    """A cell to simulate. `addresses`: device → address as written."""

    path: Path
    name: str
    robot: RobotFile
    addresses: dict[str, str]
    artefact: Artefact
    simulate: Simulate

    @property
    def folder(self) -> Path:
        """Where the cell file's paths start."""
        return self.path.parent


def read_cell(path: Path) -> SimCell:
    """The cell of a cell file that has a `simulate:` section. Raises CellError, with every mistake of both files."""
    problems: list[str] = []
    entries = _load(path)
    cell = Section(entries, "", problems)
    if "simulate" not in cell.entries:
        problems.append("it has no 'simulate:' section: it is a real cell")
    model = cell.word("model")
    for key, value in cell.entries.items():
        if isinstance(value, str) and "://" in value:
            cell.note(key, "is an address at top level; write it under `devices:`")
    devices = cell.below("devices")
    addresses = {name: devices.word(name) for name in devices.entries}
    found = SimCell(
        path=path,
        name=cell.word("name", path.stem),
        robot=read_robot(Section(_load_model(path, model, problems), model, problems)),
        addresses=addresses,
        artefact=_artefact(cell.below("artefact")),
        simulate=_simulate(cell.below("simulate"), _addressed_mode(addresses)),
    )
    if problems:
        raise CellError(path, problems)
    return found


def _load(path: Path) -> Any:
    try:
        return yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise CellError(path, [f"cannot be read: {error.strerror}"]) from None
    except (UnicodeDecodeError, yaml.YAMLError) as error:
        raise CellError(path, [f"is not YAML: {error}"]) from None


def _load_model(cell: Path, model: str, problems: list[str]) -> Any:
    """The robot file's content; what keeps it from being read is a mistake of the cell like another."""
    if not model:
        return None
    try:
        return _load(cell.parent / model)
    except CellError as error:
        problems.extend(f"model: {model} {text}" for text in error.problems)
        return None


def _artefact(section: Section) -> Artefact:
    section.only(["tip_radius", "spheres", "distances", "plate"])
    spheres = tuple(
        Sphere(sphere.word("id"), sphere.number("diameter", least=0.1), sphere.triple("centre"))
        for sphere in section.each("spheres")
    )
    names = {sphere.id for sphere in spheres}
    distances = tuple(_distance(distance, names) for distance in section.each("distances"))
    plate = _plate(section.below("plate")) if "plate" in section.entries else None
    return Artefact(section.number("tip_radius", 0.0, 0.0), spheres, distances, plate)


def _plate(section: Section) -> Plate:
    section.only(["z", "stem_radius"])
    return Plate(section.number("z"), section.number("stem_radius", 8.0, 0.0))


def _distance(section: Section, names: set[str]) -> Distance:
    between = section.entries.get("between")
    if not isinstance(between, list) or len(between) != 2 or any(str(name) not in names for name in between):
        section.note("between", f"two of the spheres {', '.join(sorted(names))} are expected, not {between!r}")
        between = ["", ""]
    return Distance(
        (str(between[0]), str(between[1])), section.number("mm", least=0.0), section.number("sigma", 0.0, 0.0)
    )


def _addressed_mode(addresses: dict[str, str]) -> str:
    """What the robot's address says of RSI_ON in the controller's program."""
    queries = [parse_qs(parts.query) for parts in map(urlsplit, addresses.values()) if parts.scheme == "kuka+rsi"]
    return "relative" if any(query.get("mode") == ["relative"] for query in queries) else "absolute"


def _simulate(section: Section, addressed_mode: str) -> Simulate:
    section.only(["seed", "clock", "errors", "rsi", "probe", "faults"])
    errors = section.below("errors")
    errors.only(ERRORS)
    lockstep = section.word("clock", "lockstep", ["lockstep", "realtime"]) != "realtime"
    return Simulate(
        seed=section.whole("seed", 1),
        clock="lockstep" if lockstep else "realtime",
        errors={kind: errors.scale(kind, usual) for kind, usual in ERRORS.items()},
        rsi=_rsi(section.below("rsi"), addressed_mode),
        probe=_probe(section.below("probe")),
        faults=tuple(_faults(section)),
    )


def _rsi(section: Section, addressed_mode: str) -> RsiSettings:
    section.only(["cycle_ms", "precision", "timeout_cycles", "counter", "mode"])
    cycle = section.whole("cycle_ms", 4, 1)
    if cycle not in {4, 12}:
        section.note("cycle_ms", f"4 or 12 is expected, not {cycle}")
    counter = section.word("counter", "total", ["total", "reset"])
    mode = section.word("mode", addressed_mode, ["absolute", "relative"])
    return RsiSettings(cycle, section.whole("precision", 4), section.whole("timeout_cycles", 100, 1), counter, mode)


def _probe(section: Section) -> ProbeSettings:
    section.only(["usb_delay_ms", "bounce"])
    bounce = section.whole("bounce", 2)
    if bounce % 2:
        section.note("bounce", f"an even number is expected (it opens and closes again), not {bounce}")
    return ProbeSettings(section.number("usb_delay_ms", 1.0, 0.0), bounce)


def _faults(section: Section) -> list[FaultSetting]:
    found = []
    for entry in section.each("faults"):
        try:
            found.append(read_fault(entry.entries))
        except FaultError as error:
            entry.problems.append(f"{entry.where}: {error}")
    return found
