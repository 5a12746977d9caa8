"""Sections of the cell file: `station:`, `reflectors:`, `floor:`, `currents:` and `postures:`."""

from __future__ import annotations

from collections import Counter
from typing import Annotated, Literal, final

from pydantic import BaseModel, ConfigDict, Field

from cellctl.files import Document, InputError, Problem
from cellctl.files.validated import validated
from cellctl.formats.artefact import Distance, Name
from cellctl.robot_file import Angles, Direction, Number, Positive, RobotFile, Triple

_STRICT = ConfigDict(extra="forbid", strict=True, frozen=True)


@final
class Nest(BaseModel):
    """A monument nest that holds a reflector; rough place in the robot's base frame, mm."""

    model_config = _STRICT
    id: Name
    xyz: Triple


@final
class Station(BaseModel):
    """The instrument. xyz, abc: rough frame of the instrument in the robot's base frame, mm and degrees (KUKA A B C).

    search_mm: half width of the search for a reflector, at the reflector. nests: monuments, at least three for the
    checks of a campaign. distances: certified distances between nests, mm.
    """

    model_config = _STRICT
    xyz: Triple
    abc: Angles
    search_mm: Positive = 40.0
    nests: list[Nest] = []
    distances: list[Distance] = []


@final
class FlangeReflector(BaseModel):
    """A reflector fixed to the robot's flange or tool: centre (mm) and the direction that it faces, flange frame."""

    model_config = _STRICT
    id: Name
    xyz: Triple
    facing: Direction


@final
class Reflectors(BaseModel):
    """The reflectors on the robot, the first one for positions, the first three for poses.

    constant_mm: added to every distance, by its certificate; centring_mm: 1 σ; acceptance_deg: half angle.
    """

    model_config = _STRICT
    constant_mm: Number = 0.0
    centring_mm: Annotated[float, Field(allow_inf_nan=False, ge=0, le=5)] = 0.01
    acceptance_deg: Annotated[float, Field(allow_inf_nan=False, gt=0, le=180)] = 30.0
    on_flange: Annotated[list[FlangeReflector], Field(min_length=1)]


@final
class Floor(BaseModel):
    """The horizontal floor: its height in the robot's base frame, mm, and how far everything stays above it."""

    model_config = _STRICT
    z: Number
    clearance_mm: Positive = 100.0


def station_of(document: Document) -> Station:
    """The `station:` of a loaded cell file. Raises InputError with every error."""
    station = validated(document, Station, ("station",))
    problems = _twice(document, ("station", "nests"), [nest.id for nest in station.nests])
    known = [nest.id for nest in station.nests]
    for index, distance in enumerate(station.distances):
        for name in distance.between:
            if name not in known:
                place = ("station", "distances", index, "between")
                problems.append(document.problem(place, f"no nest '{name}'", f"known are {', '.join(known)}"))
    if problems:
        raise InputError(problems)
    return station


def reflectors_of(document: Document) -> Reflectors:
    """The `reflectors:` of a loaded cell file. Raises InputError with every error."""
    reflectors = validated(document, Reflectors, ("reflectors",))
    problems = _twice(document, ("reflectors", "on_flange"), [one.id for one in reflectors.on_flange])
    for index, one in enumerate(reflectors.on_flange):
        if not any(one.facing):
            place = ("reflectors", "on_flange", index, "facing")
            problems.append(document.problem(place, "the direction has no length", "as [0, 0, 1]"))
    if problems:
        raise InputError(problems)
    return reflectors


def floor_of(document: Document) -> Floor | None:
    """The `floor:` of a loaded cell file, if it has one. Raises InputError."""
    has_floor = isinstance(document.data, dict) and "floor" in document.data
    return validated(document, Floor, ("floor",)) if has_floor else None


def _twice(document: Document, place: tuple[str | int, ...], names: list[str]) -> list[Problem]:
    counts = Counter(names)
    return [
        document.problem((*place, index, "id"), f"'{name}' is there twice", "give each its own name")
        for index, name in enumerate(names)
        if counts[name] > 1
    ]


_Scale = Annotated[float, Field(allow_inf_nan=False)]


@final
class Currents(BaseModel):
    """`source`: the device; its currents of A1…An become scale × current + offset, amperes of the motor.

    The sources differ in unit and sign: MACur may be percent of a drive's maximum, 0x6078 is per mille of a rated
    current. No scale: 1; no offset: 0.
    """

    model_config = _STRICT
    source: Literal["drives", "robot"]
    scale: list[_Scale] = []
    offset: list[Number] = []

    def applied(self, values: tuple[float, ...]) -> tuple[float, ...]:
        """Currents of A1…An with scale and offset."""
        scale = self.scale or [1.0] * len(values)
        offset = self.offset or [0.0] * len(values)
        return tuple(a * value + b for a, value, b in zip(scale, values, offset, strict=True))

    def applied_sigma(self, sigmas: tuple[float, ...]) -> tuple[float, ...]:
        """1 σ of A1…An with scale."""
        scale = self.scale or [1.0] * len(sigmas)
        return tuple(abs(a) * sigma for a, sigma in zip(scale, sigmas, strict=True))


def currents_of(document: Document, axes: int) -> Currents:
    """The `currents:` of a loaded cell file, for a robot of `axes` axes. Raises InputError with every error."""
    currents = validated(document, Currents, ("currents",))
    problems = []
    devices = document.data.get("devices") or {}
    if currents.source not in devices:
        what = f"there is no device '{currents.source}'"
        problems.append(document.problem(("currents", "source"), what, f"one of {', '.join(devices)}"))
    for name, values in (("scale", currents.scale), ("offset", currents.offset)):
        if values and len(values) != axes:
            what = f"{len(values)} values for {axes} axes"
            problems.append(document.problem(("currents", name), what, "one for each axis, A1 first"))
    for index, value in enumerate(currents.scale):
        if value == 0.0:
            cure = "amperes of the motor per unit of the source"
            problems.append(document.problem(("currents", "scale", index), "a scale of 0 loses the current", cure))
    if problems:
        raise InputError(problems)
    return currents


Reading = Annotated[float, Field(allow_inf_nan=False)]


@final
class Postures(BaseModel):
    """Joint readings A1…An, degrees.

    `home`: where campaigns begin and end; `touch`: from which the inverse kinematics of touches starts; `turn`: from
    which single axes are turned, also the return pose of campaigns with an instrument.
    """

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)
    home: list[Reading]
    touch: list[list[Reading]] = []
    turn: list[Reading] | None = None


def postures_of(document: Document, robot: RobotFile, need: Literal["touch", "turn"]) -> Postures:
    """The postures of a loaded cell file, checked against `robot`; `need`: those that may not be missing.

    Raises InputError with every error.
    """
    postures = validated(document, Postures, ("postures",))
    if not getattr(postures, need):
        what = f"there are no postures '{need}'"
        place = ("postures", need) if need in document.data["postures"] else ("postures",)
        raise InputError(document.problem(place, what, f"give `{need}:` with joint readings, degrees", key=True))
    problems = _problems(document, ("home",), postures.home, robot)
    if postures.turn is not None:
        problems += _problems(document, ("turn",), postures.turn, robot)
    for index, posture in enumerate(postures.touch):
        problems += _problems(document, ("touch", index), posture, robot)
    if problems:
        raise InputError(problems)
    return postures


def _problems(document: Document, at: tuple[str | int, ...], readings: list[float], robot: RobotFile) -> list[Problem]:
    place = ("postures", *at)
    if len(readings) != len(robot.joints):
        what = f"{len(readings)} joint readings for a robot with {len(robot.joints)} joints"
        return [document.problem(place, what, "write A1 to the last joint, degrees")]
    return [
        document.problem(place, f"A{number} {reading:g} is outside {joint.min:g}…{joint.max:g}°")
        for number, (reading, joint) in enumerate(zip(readings, robot.joints, strict=True), 1)
        if not joint.min <= reading <= joint.max
    ]
