"""The cell file's `station:`, `reflectors:` and `floor:`: where the instrument, its nests and the reflectors are."""

from __future__ import annotations

from collections import Counter
from typing import Annotated, final

from pydantic import BaseModel, ConfigDict, Field

from cellctl.files import Document, InputError, Problem
from cellctl.files.validated import validated
from cellctl.formats.artefact import Distance, Name
from cellctl.formats.robot import Angles, Direction, Number, Positive, Triple

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
    return validated(document, Floor, ("floor",)) if "floor" in document.data else None


def _twice(document: Document, place: tuple[str | int, ...], names: list[str]) -> list[Problem]:
    counts = Counter(names)
    return [
        document.problem((*place, index, "id"), f"'{name}' is there twice", "give each its own name")
        for index, name in enumerate(names)
        if counts[name] > 1
    ]
