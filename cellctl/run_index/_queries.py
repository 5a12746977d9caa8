"""What is asked of the index: which runs, in which order; what is found."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, final

from sqlalchemy import ColumnElement, FromClause, Select, func, select

from cellctl.run_index._content import CONTENTS, RUNS

_AFTER_ALL: Final = "\uffff"
"""Above every character of an instant: the days and instants that begin like `until` are included."""


@final
@dataclass(frozen=True, slots=True)
class RunFilter:
    """What a search asks for; an empty field asks for nothing. Letters' case does not matter.

    text: words, all of which are in the run's name, files, operator, devices, state, verdict or sentence. state,
    verdict, serial (of the robot): whole. procedure: the name of its file without suffix. since, until: first and last
    day or instant of the begin, ISO 8601.
    """

    text: str = ""
    state: str = ""
    verdict: str = ""
    serial: str = ""
    procedure: str = ""
    since: str = ""
    until: str = ""

    def conditions(self) -> list[ColumnElement[bool]]:
        """For the table of runs."""
        found = [RUNS.c.words.contains(word, autoescape=True) for word in self.text.casefold().split()]
        whole = ((RUNS.c[name], getattr(self, name)) for name in ("state", "verdict", "serial", "procedure"))
        found += [func.lower(column) == asked.lower() for column, asked in whole if asked]
        if self.since:
            found.append(RUNS.c.began >= self.since)
        if self.until:
            found += [RUNS.c.began <= self.until + _AFTER_ALL, RUNS.c.began != ""]
        return found


@final
@dataclass(frozen=True, slots=True)
class FoundRun:
    """A run of a list. content: its summary as JSON. note: that it vanished, was renamed or copied; may be empty."""

    place: str
    run: str
    content: str
    present: bool
    note: str


@final
@dataclass(frozen=True, slots=True)
class Series:
    """Runs that a history compares: how many, and when the last one began."""

    series: str
    title: str
    count: int
    last: str


def page_of(
    conditions: list[ColumnElement[bool]], order: str, *, descending: bool, offset: int = 0, limit: int | None = None
) -> Select[Any]:
    """Runs with what they hold, in an order that is the same each time; what they hold is looked up for these alone."""

    def by(table: FromClause) -> list[ColumnElement[Any]]:
        columns = [table.c[name] for name in dict.fromkeys((order, "began", "run"))]
        return [each.desc() if descending else each for each in columns]

    names = dict.fromkeys(("place", "run", "present", "identity", "began_as", "began", order))
    found = select(*(RUNS.c[name] for name in names)).where(*conditions).order_by(*by(RUNS))
    chosen = found.offset(offset).limit(limit).subquery()
    held = (chosen.c.place == CONTENTS.c.place) & (chosen.c.run == CONTENTS.c.run)
    return select(chosen, CONTENTS.c.json).join(CONTENTS, held).order_by(*by(chosen))
