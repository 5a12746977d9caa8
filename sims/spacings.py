"""Certified distances in a cell file: between spheres, or between nests."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import final

from sims.section import Section


@final
@dataclass(frozen=True, slots=True)
class Distance:
    """A certified distance between two centres, with its 1 σ, mm."""

    between: tuple[str, str]
    mm: float
    sigma: float


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
