"""Sessions of a data set, and which points are the same in several of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self, final

from cellctl.formats.columns import Sieve

if TYPE_CHECKING:
    from cellctl.calibration import Session

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
    from cellctl.calibration import Session

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
