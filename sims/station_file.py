"""The cell file's `station:` and `reflectors:`, as far as the simulated cell needs them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

from sims.robot_file import Frame, Triple
from sims.section import Section
from sims.spacings import Distance, read_distances


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
