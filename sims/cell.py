"""Reads the parts of the cell file that the simulators need; separate from `cellctl`'s reader."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

from sims.cell_content import (
    ERRORS,
    Artefact,
    Distance,
    FlangeReflector,
    Nest,
    Plate,
    Reflectors,
    SimCell,
    Simulate,
    Sphere,
    Station,
)
from sims.commissioning import measured_settings
from sims.conditions import Payload
from sims.faults import Fault, FaultCatalogue, FaultError
from sims.robot_file import Frame, RobotFile, read_robot, robot_path
from sims.section import Section
from sims.settings import read_settings
from sims.simulators import GENERAL, BadSimulator, Simulators, installed


class CellError(Exception):
    """The cell cannot be simulated with its files; the text is one block that names every error."""

    def __init__(self, path: Path, problems: list[str], what: str = "this cell cannot be simulated") -> None:
        self.problems = problems
        super().__init__("\n".join([f"{path}: {what}", *(f"  {text}" for text in problems)]))


def read_cell(path: Path, *, to_run: bool = False) -> SimCell:
    """The cell of a cell file that has a `simulate:` section. Raises CellError, with every error of both files.

    `to_run`: each of its devices must have a simulator.
    """
    problems: list[str] = []
    try:
        simulators = installed()
    except BadSimulator as error:
        raise CellError(path, [str(error)]) from None
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
    robot = read_robot(Section(_load_model(path, model, problems), model, problems))
    name = cell.word("name", path.stem)
    simulate = cell.below("simulate")
    measured = measured_settings(simulate, path.parent, name, addresses, simulators)
    found = SimCell(
        path=path,
        name=name,
        robot=robot,
        addresses=addresses,
        artefact=_artefact(cell.below("artefact")),
        simulate=_simulate(simulate, simulators, simulators.catalogue(addresses.values()), measured),
        home=_home(cell.below("postures"), robot),
        station=read_station(cell.below("station")) if "station" in cell.entries else None,
        load=_load_of(cell.below("load")),
        reflectors=read_reflectors(cell.below("reflectors")) if "reflectors" in cell.entries else None,
    )
    if to_run:
        problems += simulators.problems(addresses)
    if problems:
        raise CellError(path, problems)
    return found


def read_distances(section: Section, names: Iterable[str], of_what: str) -> tuple[Distance, ...]:
    """The section's `distances:`, each between two of `names`; errors are noted in the section's problems."""
    known = set(names)
    return tuple(_distance(distance, known, of_what) for distance in section.each("distances"))


def _distance(section: Section, names: set[str], of_what: str) -> Distance:
    between = section.entries.get("between")
    if not isinstance(between, list) or len(between) != 2 or any(str(name) not in names for name in between):
        section.note("between", f"two of the {of_what} {', '.join(sorted(names))} are expected, not {between!r}")
        between = ["", ""]
    return Distance(
        (str(between[0]), str(between[1])), section.number("mm", least=0.0), section.number("sigma", 0.0, 0.0)
    )


def read_station(section: Section) -> Station:
    """Errors are noted in the section's problems."""
    section.only(["xyz", "abc", "search_mm", "nests", "distances"])
    nests = tuple(Nest(nest.word("id"), nest.triple("xyz")) for nest in section.each("nests"))
    return Station(
        frame=Frame(section.triple("xyz"), section.triple("abc")),
        search_mm=section.number("search_mm", 40.0, 0.0),
        nests=nests,
        distances=read_distances(section, [nest.id for nest in nests], "nests"),
    )


def read_reflectors(section: Section) -> Reflectors:
    """Errors are noted in the section's problems."""
    section.only(["constant_mm", "centring_mm", "acceptance_deg", "on_flange"])
    return Reflectors(
        constant_mm=section.number("constant_mm", 0.0),
        centring_mm=section.number("centring_mm", 0.01, 0.0),
        acceptance_deg=section.number("acceptance_deg", 30.0, 0.0),
        on_flange=tuple(_on_flange(one) for one in section.each("on_flange", required=True)),
    )


def _on_flange(section: Section) -> FlangeReflector:
    facing = section.triple("facing")
    if not any(facing):
        section.note("facing", "a direction is expected, not all 0")
        facing = (0.0, 0.0, 1.0)
    return FlangeReflector(section.word("id"), section.triple("xyz"), facing)


def _home(section: Section, robot: RobotFile) -> tuple[float, ...]:
    """From the cell file, else every joint at 0 or at the nearest axis limit."""
    home = section.numbers("home", len(robot.joints)) if "home" in section.entries else (0.0,) * len(robot.joints)
    return tuple(min(max(angle, axis.min), axis.max) for angle, axis in zip(home, robot.joints, strict=True))


def _load(path: Path) -> Any:
    try:
        return yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise CellError(path, [f"cannot be read: {error.strerror}"]) from None
    except (UnicodeDecodeError, yaml.YAMLError) as error:
        raise CellError(path, [f"is not YAML: {error}"]) from None


def _load_model(cell: Path, model: str, problems: list[str]) -> Any:
    """The robot file's content; a failure to read it is an error of the cell."""
    if not model:
        return None
    try:
        return _load(robot_path(model, cell.parent))
    except CellError as error:
        problems.extend(f"model: {model} {text}" for text in error.problems)
        return None


def _artefact(section: Section) -> Artefact:
    section.only(["tip_radius", "spheres", "distances", "plate"])
    spheres = tuple(
        Sphere(sphere.word("id"), sphere.number("diameter", least=0.1), sphere.triple("centre"))
        for sphere in section.each("spheres")
    )
    distances = read_distances(section, [sphere.id for sphere in spheres], "spheres")
    plate = _plate(section.below("plate")) if "plate" in section.entries else None
    return Artefact(section.number("tip_radius", 0.0, 0.0), spheres, distances, plate)


def _plate(section: Section) -> Plate:
    section.only(["z", "stem_radius"])
    return Plate(section.number("z"), section.number("stem_radius", 8.0, 0.0))


def _simulate(
    section: Section, simulators: Simulators, catalogue: FaultCatalogue, measured: Mapping[str, Mapping[str, Any]]
) -> Simulate:
    """`measured`: section → setting → value, for those that the file does not state."""
    with_settings = [one for one in simulators.all if one.section]
    section.only([*GENERAL, *(one.section for one in with_settings)])
    parts = {one.section: section.below(one.section) for one in with_settings}
    for name, part in parts.items():
        part.entries = {**measured.get(name, {}), **part.entries}
    errors = section.below("errors")
    errors.only(ERRORS)
    lockstep = section.word("clock", "lockstep", ["lockstep", "realtime"]) != "realtime"
    return Simulate(
        seed=section.whole("seed", 1),
        clock="lockstep" if lockstep else "realtime",
        errors={kind: errors.scale(kind, usual) for kind, usual in ERRORS.items()},
        settings={one.section: read_settings(one.settings, parts[one.section]) for one in with_settings},
        faults=tuple(_faults(section, catalogue)),
        payload=_payload(section.below("payload")),
    )


def _payload(section: Section) -> Payload | None:
    section.only(["mass", "xyz"])
    return _load_of(section)


def _load_of(section: Section) -> Payload | None:
    """Of a section with `mass` and `xyz`; another key of it is not for the simulated cell."""
    if not section.entries:
        return None
    return Payload(section.number("mass", least=0.0), section.triple("xyz"))


def _faults(section: Section, catalogue: FaultCatalogue) -> list[Fault]:
    found = []
    for entry in section.each("faults"):
        try:
            found.append(catalogue.read(entry.entries))
        except FaultError as error:
            entry.problems.append(f"{entry.where}: {error}")
    return found
