"""Some rows in another unit than the others: positions, or one coordinate of them, in metres; angles in radians.

The size of their numbers gives a first guess of these rows. Then each row is taken in the unit in which it is nearer to
the robot, and the robot is registered again, until no row changes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, final

import numpy as np

from cellctl.kinematics import Bools, Floats
from cellctl.setup_check._units_and_conventions import RADIANS_UP_TO, UNITS
from cellctl.setup_check.hypothesis import Change, Hypothesis, Setup
from cellctl.setup_check.misfit import EXPLAINED, SAMPLE, SCREEN, Misfit, distances, misfit

NEARER = 4.0
"""The other unit has to bring a row nearer by this factor."""

AT_LEAST = 2
"""Rows of each unit."""

GAPS = 6
"""Places where rows may divide into small numbers and large ones: the widest gaps between sizes, as ratios."""

CAPPED_MM = 50.0
PROMISING = 3
ROUNDS = 4
NAMED = 3
"""Rows, or runs of rows, that are named; the others are counted."""


@final
@dataclass(frozen=True, eq=False)
class _Unit:
    """A unit that some rows may be in. what: `X, Y, Z look like metres (× 1000)`. sizes: how large each row's numbers
    are (M,); changed: the set-up with the rows at a mask (M,) in that unit. whole: whether all rows may be.
    """

    what: str
    columns: tuple[str, ...]
    sizes: Callable[[Setup], Floats]
    changed: Callable[[Setup, Bools], Setup]
    whole: bool = False

    def guesses(self, setup: Setup) -> Iterator[Bools]:
        """Which rows (M,) are in this unit, by their sizes alone."""
        sizes = self.sizes(setup)
        usable = np.isfinite(sizes) & (sizes > 0.0)
        order = np.sort(np.log(sizes[usable]))
        gaps = np.diff(order)
        for place in np.argsort(-gaps, kind="stable")[:GAPS]:
            yield usable & (np.log(np.where(usable, sizes, 1.0)) <= order[place] + 1e-12)
        if self.whole:
            yield usable


def mixed_units(setup: Setup) -> Iterator[Hypothesis]:
    """Rows in another unit than the rest, at most one hypothesis; rows of both units must be certain."""
    sample = setup.thinned(SAMPLE)
    guessed: list[tuple[float, int, _Unit, Bools]] = []
    for unit in _units(sample):
        for guess in unit.guesses(sample):
            guessed.append((_rough(unit.changed(sample, guess).thinned(SCREEN)), len(guessed), unit, guess))
    for _, _, unit, guess in sorted(guessed, key=lambda one: one[:2])[:PROMISING]:
        about = _settled(sample, unit, guess)
        found = _rows_of(setup, unit, about)
        if about.ratio <= EXPLAINED and _enough(found, unit):
            yield Hypothesis((_change(unit, found),), unit.changed(setup, found))
            return


def _rough(setup: Setup) -> float:
    """Mean distance of all rows from nominal, mm, each capped at `CAPPED_MM`."""
    return float(np.mean(np.minimum(distances(setup, misfit(setup, rounds=2).state), CAPPED_MM)))


def _settled(sample: Setup, unit: _Unit, guess: Bools) -> Misfit:
    """Nominal registered with each row in the unit in which it is nearer."""
    for _ in range(ROUNDS):
        about, before = misfit(unit.changed(sample, guess)), guess
        guess = distances(unit.changed(sample, np.ones(len(guess), bool)), about.state) < distances(sample, about.state)
        if np.array_equal(guess, before):
            break
    return about.with_prediction(unit.changed(sample, guess))


def _rows_of(setup: Setup, unit: _Unit, about: Misfit) -> Bools:
    """Which of all rows (M,) are wrong as given, and right in the unit; all, where no row contradicts that."""
    limit = about.limit_mm
    plain = distances(setup, about.state)
    other = distances(unit.changed(setup, np.ones(len(plain), bool)), about.state)
    found = (plain > limit) & (other < limit) & (NEARER * other < plain)
    if unit.whole and found.any() and np.all((plain > limit) | (other < limit)):
        return np.ones_like(found)
    return np.asarray(found)


def _enough(found: Bools, unit: _Unit) -> bool:
    return int(np.count_nonzero(found)) >= AT_LEAST and (unit.whole or int(np.count_nonzero(~found)) >= AT_LEAST)


def _units(setup: Setup) -> Iterator[_Unit]:
    if setup.task.rows.has_positions:
        for name, factor in UNITS.items():
            for axes in ([0, 1, 2], [0], [1], [2]):
                columns = tuple("XYZ"[axis] for axis in axes)
                look = "look" if len(axes) > 1 else "looks"
                what = f"{', '.join(columns)} {look} like {name} (× {factor:g})"
                yield _Unit(what, columns, partial(_sizes, axes), partial(_scaled, axes, factor), whole=len(axes) == 1)
    if np.count_nonzero(_turned_little(setup)) >= AT_LEAST:
        columns = tuple(f"A{joint + 1}" for joint in np.flatnonzero(setup.revolute))
        what = f"{columns[0]}…{columns[-1]} look like radians (× 180/π)"
        yield _Unit(what, columns, lambda of: np.abs(of.readings[:, of.revolute]).max(axis=1), _in_radians)


def _turned_little(setup: Setup) -> Bools:
    """Rows (M,) whose readings may be radians."""
    turning = np.abs(setup.readings[:, setup.revolute])
    return np.asarray((turning < RADIANS_UP_TO).all(axis=1)) if turning.size else np.zeros(len(turning), bool)


def _in_radians(setup: Setup, which: Bools) -> Setup:
    mine = which & _turned_little(setup)
    mine = mine[:, None] & setup.revolute
    return setup.with_readings(np.where(mine, np.rad2deg(setup.readings), setup.readings))


def _sizes(axes: list[int], setup: Setup) -> Floats:
    """Size of the coordinates at `axes` (M,), mm; NaN for rows without any."""
    return np.asarray(np.linalg.norm(setup.positions[:, axes], axis=1))


def _scaled(axes: list[int], factor: float, setup: Setup, which: Bools) -> Setup:
    """The coordinates at `axes` of the rows at `which` (M,) times `factor`."""
    by = np.ones((len(which), 3))
    by[np.ix_(which, np.array(axes))] = factor
    return setup.with_positions(by * setup.positions)


def _change(unit: _Unit, found: Bools) -> Change:
    """In words: `in lines 22…41 X, Y, Z look like metres (× 1000)`, with places for the rows' names."""
    stretches = _stretches(np.flatnonzero(found))
    rows: list[int] = []
    places = []
    for first, last in stretches[:NAMED]:
        places.append(f"{{{len(rows)}}}" if first == last else f"{{{len(rows)}}} to {{{len(rows) + 1}}}")
        rows += [first] if first == last else [first, last]
    count = int(np.count_nonzero(found))
    more = f", … ({count} rows)" if len(stretches) > NAMED else ""
    where = "all rows" if found.all() else f"{', '.join(places)}{more}"
    cure = f"write {', '.join(unit.columns)} in one unit: {'degrees' if unit.columns[0].startswith('A') else 'mm'}"
    return Change(f"in {where} {unit.what}", "data", cure, unit.columns, tuple(rows))


def _stretches(rows: Any) -> list[tuple[int, int]]:
    """First and last of each run of consecutive rows."""
    parts = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    return [(int(part[0]), int(part[-1])) for part in parts if len(part)]
