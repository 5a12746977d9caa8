"""Some rows in another unit than the others: positions, or one coordinate of them, in metres; angles in radians.

Which rows these are shows in how small their numbers are, roughly, and then in where the robot is: each row is taken in
the unit in which it is nearer to the robot, which is registered again, until no row changes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np

from cellctl.calibration.mistakes.case import Case
from cellctl.calibration.mistakes.columns import RADIANS_UP_TO
from cellctl.calibration.mistakes.measured import UNITS
from cellctl.calibration.mistakes.misfit import EXPLAINED, Misfit, misfit, row_errors
from cellctl.calibration.mistakes.supposition import Change, Supposition
from cellctl.calibration.model.unknowns import State
from cellctl.calibration.rows import Measured, PoseRows, PositionRows
from cellctl.kinematics import Bools, Floats

FAR = 8.0
"""Times the foreseen distance from which on a row is not where the model says."""

NEARER = 4.0
"""The other unit has to bring a row this many times nearer."""

AT_LEAST = 2
"""Rows of each unit."""

SCREEN = 60
SAMPLE = 150
GAPS = 6
"""Places where rows may part into small numbers and large ones: the widest gaps between sizes, as ratios."""

CAPPED_MM = 50.0
PROMISING = 3
ROUNDS = 4
NAMED = 3
"""Rows, or stretches of rows, that are named; the others are counted."""


@final
@dataclass(frozen=True, eq=False)
class _Unit:
    """A unit that some rows may be in. what: `X, Y, Z look like metres (× 1000)`. sizes: how large each row's numbers
    are (M,); changed: the case with the rows at a mask (M,) taken so. whole: whether all rows may be meant.
    """

    what: str
    columns: tuple[str, ...]
    sizes: Callable[[Case], Floats]
    changed: Callable[[Case, Bools], Case]
    whole: bool = False

    def guesses(self, case: Case) -> Iterator[Bools]:
        """Which rows (M,) are in this unit, by their sizes alone."""
        sizes = self.sizes(case)
        usable = np.isfinite(sizes) & (sizes > 0.0)
        order = np.sort(np.log(sizes[usable]))
        gaps = np.diff(order)
        for place in np.argsort(-gaps, kind="stable")[:GAPS]:
            yield usable & (np.log(np.where(usable, sizes, 1.0)) <= order[place] + 1e-12)
        if self.whole:
            yield usable


def mixed_units(case: Case) -> Iterator[Supposition]:
    """Rows in another unit than the rest, at most one supposition; both have to be told beyond doubt."""
    few = case.thinned(SAMPLE)
    guessed: list[tuple[float, int, _Unit, Bools]] = []
    for unit in _units(few):
        for guess in unit.guesses(few):
            guessed.append((_rough(unit.changed(few, guess).thinned(SCREEN)), len(guessed), unit, guess))
    for _, _, unit, guess in sorted(guessed, key=lambda one: one[:2])[:PROMISING]:
        about = _settled(few, unit, guess)
        found = _rows_of(case, unit, about)
        if about.times <= EXPLAINED and _enough(found, unit):
            yield Supposition((_change(unit, found),), unit.changed(case, found))
            return


def _rough(case: Case) -> float:
    """How far all rows are from nominal on average, mm, none of them counted for more than `CAPPED_MM`."""
    return float(np.mean(np.minimum(_errors(case, misfit(case, rounds=2).state), CAPPED_MM)))


def _settled(few: Case, unit: _Unit, guess: Bools) -> Misfit:
    """Nominal registered with each row in the unit in which it is nearer."""
    for _ in range(ROUNDS):
        about, before = misfit(unit.changed(few, guess)), guess
        guess = _errors(unit.changed(few, np.ones(len(guess), bool)), about.state) < _errors(few, about.state)
        if np.array_equal(guess, before):
            break
    return about.foreseen(unit.changed(few, guess))


def _rows_of(case: Case, unit: _Unit, about: Misfit) -> Bools:
    """Which of all rows (M,) are wrong as they are, and right in the unit; all, where none contradicts that."""
    limit = FAR * max(about.foreseen_mm, about.mm)
    plain = _errors(case, about.state)
    other = _errors(unit.changed(case, np.ones(len(plain), bool)), about.state)
    found = (plain > limit) & (other < limit) & (NEARER * other < plain)
    if unit.whole and found.any() and np.all((plain > limit) | (other < limit)):
        return np.ones_like(found)
    return np.asarray(found)


def _enough(found: Bools, unit: _Unit) -> bool:
    return int(np.count_nonzero(found)) >= AT_LEAST and (unit.whole or int(np.count_nonzero(~found)) >= AT_LEAST)


def _errors(case: Case, state: State) -> Floats:
    return np.concatenate([mm for mm, _ in row_errors(case.task, state)])


def _units(case: Case) -> Iterator[_Unit]:
    if case.task.rows.kinds & {PositionRows, PoseRows}:
        for name, factor in UNITS.items():
            for axes in ((0, 1, 2), (0,), (1,), (2,)):
                columns = tuple("XYZ"[axis] for axis in axes)
                look = "look" if len(axes) > 1 else "looks"
                what = f"{', '.join(columns)} {look} like {name} (× {factor:g})"
                yield _Unit(what, columns, _Sizes(axes), _Scaled(axes, factor), whole=len(axes) == 1)
    if np.count_nonzero(_turned_little(case)) >= AT_LEAST:
        columns = tuple(f"A{joint + 1}" for joint in range(case.n))
        what = f"{columns[0]}…{columns[-1]} look like radians (× 180/π)"
        yield _Unit(what, columns, lambda of: np.abs(of.readings).max(axis=1), _in_radians)


def _turned_little(case: Case) -> Bools:
    """Rows (M,) whose readings may be radians."""
    return np.asarray(np.abs(case.readings).max(axis=1) < RADIANS_UP_TO)


def _in_radians(case: Case, which: Bools) -> Case:
    mine = which & _turned_little(case)
    return case.with_readings(np.where(mine[:, None], np.rad2deg(case.readings), case.readings))


@final
@dataclass(frozen=True)
class _Sizes:
    """How large the coordinates at `axes` are (M,), mm; NaN for rows without any."""

    axes: tuple[int, ...]

    def __call__(self, case: Case) -> Floats:
        found = [_size(block, list(self.axes)) for block in case.task.rows.blocks]
        return np.concatenate(found)


def _size(block: Measured, axes: list[int]) -> Floats:
    if not isinstance(block, PositionRows | PoseRows):
        return np.full(len(block), np.nan)
    return np.asarray(np.linalg.norm(block.xyz[:, axes], axis=1))


@final
@dataclass(frozen=True)
class _Scaled:
    """Coordinates at `axes` of some rows times `factor`."""

    axes: tuple[int, ...]
    factor: float

    def __call__(self, case: Case, which: Bools) -> Case:
        starts = iter(np.cumsum([0, *map(len, case.task.rows.blocks)]).tolist())

        def scaled(block: Measured) -> Measured:
            start = next(starts)
            return self._block(block, which[start : start + len(block)])

        return case.with_blocks(scaled)

    def _block(self, block: Measured, mine: Bools) -> Measured:
        if not isinstance(block, PositionRows | PoseRows):
            return block
        by = np.ones((len(block), 3))
        by[np.ix_(mine, np.array(self.axes))] = self.factor
        if isinstance(block, PositionRows):
            return replace(block, xyz=block.xyz * by)
        poses = block.poses.copy()
        poses[:, :3, 3] *= by
        return replace(block, poses=poses)


def _change(unit: _Unit, found: Bools) -> Change:
    """In words: `in lines 22…41 X, Y, Z look like metres (× 1000)`, with places for the rows' names."""
    stretches = _stretches(np.flatnonzero(found))
    rows: list[int] = []
    said = []
    for first, last in stretches[:NAMED]:
        said.append(f"{{{len(rows)}}}" if first == last else f"{{{len(rows)}}} to {{{len(rows) + 1}}}")
        rows += [first] if first == last else [first, last]
    count = int(np.count_nonzero(found))
    more = f", … ({count} rows)" if len(stretches) > NAMED else ""
    where = "all rows" if found.all() else f"{', '.join(said)}{more}"
    cure = f"write {', '.join(unit.columns)} in one unit: {'degrees' if unit.columns[0] == 'A1' else 'mm'}"
    return Change(f"in {where} {unit.what}", "data", cure, unit.columns, tuple(rows))


def _stretches(rows: Any) -> list[tuple[int, int]]:
    """First and last of rows that follow each other."""
    parts = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    return [(int(part[0]), int(part[-1])) for part in parts if len(part)]
