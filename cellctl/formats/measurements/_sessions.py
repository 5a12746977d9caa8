"""Sessions of a data set, points that are the same in several of them, and known distances between points."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Self, final

import numpy as np

from cellctl.calibration import Session, SpacingRows
from cellctl.files import InputError, Problem
from cellctl.formats.artefact import Artefact
from cellctl.formats.dataset import Sieve
from cellctl.kinematics import Floats

OWN = ("base", "tool")
"""Groups that a session may have of its own."""

OWN_BASE = frozenset({"base"})


def session_names(sieve: Sieve) -> list[str]:
    """The `session` column (N,); once it is used, each row must name its session."""
    names = sieve.data.texts("session")
    if any(names):
        for row, name in enumerate(names):
            if not name:
                sieve.reject(row, "session is missing")
    return names


def sessions_of(names: Sequence[str], own: frozenset[str], *, instrument: bool) -> tuple[Session, ...]:
    """The sessions in the order of their first rows.

    A base is a session's own only where an instrument measured: fixed points do not determine it. Sessions without
    their own groups are merged.
    """
    mine = own if instrument else own - OWN_BASE
    distinct = list(dict.fromkeys(names))
    if not mine or len(distinct) < 2:
        return (Session(distinct[0] if len(distinct) == 1 else "", mine),)
    return tuple(Session(name, mine) for name in distinct)


@final
@dataclass(frozen=True, slots=True)
class Points:
    """Fixed points by name and session; a session of "" where it does not matter."""

    keys: tuple[tuple[str, str], ...]

    @classmethod
    def of(cls, names: Sequence[str], sessions: Sequence[str], *, apart: bool) -> Self:
        """The points that rows name, in order of name. apart: those of different sessions are different points, because
        the robot was moved.
        """
        pairs = zip(names, sessions, strict=True)
        return cls(tuple(sorted({(name, session if apart else "") for name, session in pairs if name})))

    @property
    def names(self) -> tuple[str, ...]:
        """A name for each, with its session (`S1@Tuesday`) where several have it."""
        plain = [name for name, _ in self.keys]
        return tuple(name if plain.count(name) == 1 else f"{name}@{session}" for name, session in self.keys)

    def number(self, name: str, session: str) -> int:
        """The number of a row's point."""
        key = (name, session)
        return self.keys.index(key if key in self.keys else (name, ""))

    def pairs(self, first: str, second: str) -> list[tuple[int, int]]:
        """Numbers of the points of these two names, for each session that has both."""
        place = {key: number for number, key in enumerate(self.keys)}
        return [
            (place[first, session], place[second, session])
            for name, session in self.keys
            if name == first and (second, session) in place
        ]


_WORDS = re.compile(
    r"\s*(?P<first>[^,=]+?)\s*,\s*(?P<second>[^,=]+?)\s*=\s*(?P<mm>[\d.]+)\s*(?:±|\+-)\s*(?P<sigma>[\d.]+)\s*"
)


@final
@dataclass(frozen=True, slots=True)
class Spacing:
    """The distance between two fixed points, mm, and its 1 σ, mm."""

    between: tuple[str, str]
    mm: float
    sigma: float

    @classmethod
    def parse(cls, words: str) -> Self:
        """From `A,B=50±0.01` (or `+-`). Raises InputError."""
        found = _WORDS.fullmatch(words)
        try:
            assert found is not None
            spacing = cls((found["first"], found["second"]), float(found["mm"]), float(found["sigma"]))
            assert spacing.mm > 0.0 < spacing.sigma
        except (AssertionError, ValueError):
            what = f"'{words}' is no distance between two points"
            raise InputError(Problem("--spacing", 0, 0, what, "write A,B=50±0.01 (or 50+-0.01), mm and 1 σ")) from None
        if spacing.between[0] == spacing.between[1]:
            raise InputError(Problem("--spacing", 0, 0, f"'{words}': a distance is between two points", "name both"))
        return spacing


def spacing_rows(
    points: Points, artefact: Artefact | None, said: Sequence[Spacing], *, use_artefact: bool = True
) -> SpacingRows | None:
    """The known distances between points of the data, once for each session; None where there is none.

    Raises InputError where a `said` distance is between points that no row names.
    """
    known = known_spacings(artefact if use_artefact else None, _named(points, said))
    rows = [(pair, each) for each in known for pair in points.pairs(*each.between)]
    if not rows:
        return None
    pairs = np.array([pair for pair, _ in rows])
    return SpacingRows(pairs, np.array([each.mm for _, each in rows]), np.array([[each.sigma] for _, each in rows]))


def known_spacings(artefact: Artefact | None, said: Sequence[Spacing]) -> list[Spacing]:
    """The artefact's certified distances, and those `said`."""
    certified = artefact.distances if artefact else []
    return [*(Spacing((item.between[0], item.between[1]), item.mm, item.sigma) for item in certified), *said]


def rough_places(points: Points, artefact: Artefact | None) -> Floats | None:
    """Rough places of the points (S, 3), mm, from the artefact; NaN where it has none, or where the robot was set up
    anew between sessions.
    """
    if artefact is None or not points.keys:
        return None
    once = [point == name for point, (name, _) in zip(points.names, points.keys, strict=True)]
    centres = [artefact.place(name) if alone else None for (name, _), alone in zip(points.keys, once, strict=True)]
    return np.array([centre or [math.nan] * 3 for centre in centres], float)


def refuse_planes(planes: Sequence[str], said: Sequence[Spacing]) -> None:
    """Raise InputError where a distance in `said` is to one of the `planes`."""
    for name in dict.fromkeys(name for each in said for name in each.between if name in planes):
        raise InputError(Problem("--spacing", 0, 0, f"'{name}' is a plane", "name spheres, sockets or anchors"))


def _named(points: Points, said: Iterable[Spacing]) -> list[Spacing]:
    wanted = list(said)
    names = {name for name, _ in points.keys}
    unknown = dict.fromkeys(name for each in wanted for name in each.between if name not in names)
    if unknown:
        known = f"points here: {', '.join(sorted(names)[:12])}" if names else "no row names a point"
        raise InputError(Problem("--spacing", 0, 0, f"no point '{name}'", known) for name in unknown)
    return wanted
