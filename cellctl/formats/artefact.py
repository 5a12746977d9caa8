"""Artefacts: the spheres and planes that a robot touches: sizes, rough places, certified distances."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, final

from pydantic import BaseModel, ConfigDict, Field

from cellctl.files import Document, InputError, Problem, load_yaml
from cellctl.files import Path as Place
from cellctl.files.kinds import ARTEFACT, CELL, kind_of_content, refuse_other_kind
from cellctl.files.validated import validated
from cellctl.robot_file import Positive, Triple

_STRICT = ConfigDict(extra="forbid", strict=True, frozen=True)
Name = Annotated[str, Field(min_length=1)]


@final
class Sphere(BaseModel):
    """A calibration sphere; diameter in mm, rough centre, mm, in the robot's base frame."""

    model_config = _STRICT
    id: Name
    diameter: Annotated[float, Field(allow_inf_nan=False, gt=0, le=2000)]
    centre: Triple


@final
class Socket(BaseModel):
    """A socket that holds the tool's ball or tip; rough centre, mm, in the robot's base frame, where it is known."""

    model_config = _STRICT
    id: Name
    centre: Triple | None = None


@final
class Plane(BaseModel):
    """A plane that is touched by a tip; the fit finds its place. The robot is on its side."""

    model_config = _STRICT
    id: Name


@final
class Distance(BaseModel):
    """A certified distance between two points (sphere centres, sockets), mm, and its standard deviation, mm."""

    model_config = _STRICT
    between: Annotated[list[Name], Field(min_length=2, max_length=2)]
    mm: Positive
    sigma: Positive


@final
class Plate(BaseModel):
    """The horizontal plate that carries the spheres on vertical stems: its height in the base frame, mm."""

    model_config = _STRICT
    z: Annotated[float, Field(allow_inf_nan=False)]
    stem_radius: Annotated[float, Field(allow_inf_nan=False, gt=0, le=500)] = 8.0


@final
class Artefact(BaseModel):
    """Spheres, planes, sockets, certified distances; tip_radius of the touching ball or wire, mm; the plate, where
    known.
    """

    model_config = _STRICT
    tip_radius: Annotated[float, Field(allow_inf_nan=False, ge=0, le=100)] = 0.0
    spheres: list[Sphere] = []
    planes: list[Plane] = []
    sockets: list[Socket] = []
    distances: list[Distance] = []
    plate: Plate | None = None

    @property
    def points(self) -> list[Sphere | Socket]:
        """Spheres and sockets."""
        return [*self.spheres, *self.sockets]

    def sphere(self, name: str) -> Sphere | None:
        """The sphere called `name`, or None."""
        return next((sphere for sphere in self.spheres if sphere.id == name), None)

    def place(self, name: str) -> list[float] | None:
        """Rough place of the sphere or socket called `name`, mm; None where it is not stated."""
        return next((point.centre for point in self.points if point.id == name), None)


def load_artefact(path: Path) -> Artefact:
    """Read an artefact from its own file, or from a cell file's `artefact:` section. Raises InputError, all at once."""
    document = load_yaml(path)
    if (found := kind_of_content(document.data)) != CELL:
        refuse_other_kind(path, ARTEFACT, found)
    whole = document.data
    if not isinstance(whole, dict):
        raise InputError(document.problem((), "is no mapping", "write tip_radius, spheres and distances"))
    return artefact_of(document, ("artefact",) if "artefact" in whole else ())


def artefact_of(document: Document, at: Place) -> Artefact:
    """The artefact at `at` of a loaded document. Raises InputError with every error."""
    artefact = validated(document, Artefact, at)
    problems = [] if artefact.points or artefact.planes else [_nothing(document, at)]
    problems += [*_doubles(document, artefact, at), *_above_plate(document, artefact, at)]
    problems += _distances(document, artefact, at)
    if problems:
        raise InputError(problems)
    return artefact


def _nothing(document: Document, at: Place) -> Problem:
    return document.problem(
        (*at, "spheres"), "holds neither spheres nor sockets nor planes", "spheres:, sockets: or planes:", key=True
    )


def _doubles(document: Document, artefact: Artefact, at: Place) -> list[Problem]:
    points: dict[str, Sequence[Sphere | Socket | Plane]] = {
        "spheres": artefact.spheres,
        "planes": artefact.planes,
        "sockets": artefact.sockets,
    }
    counts = Counter(point.id for listed in points.values() for point in listed)
    return [
        document.problem((*at, kind, index, "id"), f"{kind.removesuffix('s')} '{point.id}' is there twice")
        for kind, listed in points.items()
        for index, point in enumerate(listed)
        if counts[point.id] > 1
    ]


def _above_plate(document: Document, artefact: Artefact, at: Place) -> list[Problem]:
    plate = artefact.plate
    return [
        document.problem(
            (*at, "spheres", index, "centre"), f"sphere '{sphere.id}' is not above the plate (z {plate.z:g})"
        )
        for index, sphere in enumerate(artefact.spheres)
        if plate and sphere.centre[2] - sphere.diameter / 2 < plate.z
    ]


def _distances(document: Document, artefact: Artefact, at: Place) -> list[Problem]:
    problems = []
    named = [point.id for point in artefact.points]
    for index, distance in enumerate(artefact.distances):
        place = (*at, "distances", index, "between")
        unknown = [name for name in distance.between if name not in named]
        if unknown:
            kind = "sphere or socket" if artefact.sockets else "sphere"
            problems.append(document.problem(place, f"no {kind} '{unknown[0]}'", f"known are {', '.join(named)}"))
        elif distance.between[0] == distance.between[1]:
            kind = "points" if artefact.sockets else "spheres"
            problems.append(document.problem(place, f"a distance is between two different {kind}"))
        else:
            problems += _far_from_rough(document, artefact, distance, (*at, "distances", index, "mm"))
    return problems


def _far_from_rough(document: Document, artefact: Artefact, distance: Distance, place: Place) -> list[Problem]:
    """Certified distances that contradict the rough places (metres, a typing error): one would distort the whole
    fit.
    """
    first, second = (artefact.place(name) for name in distance.between)
    if first is None or second is None:
        return []
    rough = sum((a - b) ** 2 for a, b in zip(first, second, strict=True)) ** 0.5
    if abs(rough - distance.mm) <= max(20.0, 0.1 * rough):
        return []
    names = " and ".join(distance.between)
    what = f"{distance.mm:g} mm, but the rough places of {names} are {rough:.1f} mm apart"
    return [document.problem(place, what, "mm? the right spheres? correct the distance or the centres")]
