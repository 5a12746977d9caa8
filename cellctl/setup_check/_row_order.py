"""Shifted rows: measurements that belong to the joints of another row; two exchanged rows.

A robot registered on matching rows shows to which joints the measurement of every other row belongs.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np

from cellctl.calibration.rows import Measured
from cellctl.setup_check.hypothesis import Change, Hypothesis, Setup
from cellctl.setup_check.misfit import EXPLAINED, Misfit, distances, misfit

FURTHEST = 5
"""Largest shift between measurements and joints, in rows."""

SHIFTS = sorted((by for by in range(-FURTHEST, FURTHEST + 1) if by), key=abs)
"""All tested shifts of rows, the smallest first."""

RUN = 4
"""Least count of consecutive rows with one shift: fewer may be a coincidence."""

MOST = 20_000
"""Only the first rows are used; beyond them a shift is the same."""

EXCHANGED_AT_MOST = 100
"""Most outliers among which pairs are searched."""


@final
@dataclass(frozen=True, slots=True)
class Stretch:
    """Rows first … last of a block whose measurements belong to the joints `by` rows before (negative: after)."""

    first: int
    last: int
    by: int


@final
class RowMatches:
    """A block of rows, and which of its measurements `nominal` predicts, at their own joints or those of other rows."""

    def __init__(self, block: Measured, nominal: Misfit) -> None:
        self.block, self.nominal = block.pick(np.s_[:MOST]), nominal
        self.size = len(self.block)
        self.near = self._near(np.arange(self.size), np.arange(self.size))

    def stretches(self) -> list[Stretch]:
        """Runs of outliers that all belong to joints with the same shift."""
        if np.count_nonzero(~self.near) < RUN:
            return []
        rows = np.arange(self.size)
        best: dict[int, Any] = {}
        for by in SHIFTS:
            inside = (rows - by >= 0) & (rows - by < self.size)
            fits = np.zeros(self.size, bool)
            fits[inside] = self._near(rows[inside], rows[inside] - by)
            best[by] = fits
        return list(self._runs(best))

    def exchanged(self, stretches: list[Stretch]) -> list[tuple[int, int]]:
        """Pairs of outliers that each fit the other's joints."""
        taken = {row for stretch in stretches for row in range(stretch.first, stretch.last + 1)}
        outliers = [int(row) for row in np.flatnonzero(~self.near) if row not in taken]
        if not 2 <= len(outliers) <= EXCHANGED_AT_MOST:
            return []
        pairs = np.array(list(itertools.combinations(outliers, 2)))
        both = self._near(pairs[:, 0], pairs[:, 1]) & self._near(pairs[:, 1], pairs[:, 0])
        result: list[tuple[int, int]] = []
        for first, second in pairs[both].tolist():
            if not {first, second} & {row for pair in result for row in pair}:
                result.append((first, second))
        return result

    def _runs(self, fits: dict[int, Any]) -> Iterator[Stretch]:
        """From the first row on, the shift that explains most of the next rows; single rows may still be outliers."""
        row = 0
        while row < self.size:
            if self.near[row]:
                row += 1
                continue
            reach = {by: self._length(row, which) for by, which in fits.items()}
            by = max(reach, key=lambda shift: (reach[shift], -abs(shift)))
            if reach[by] >= RUN:
                yield Stretch(row, row + reach[by] - 1, by)
            row += max(reach[by], 1)

    def _length(self, row: int, fits: Any) -> int:
        """Count of rows from `row` on that a shift explains better than no shift; two consecutive misses end it."""
        misses, end = 0, row
        for place in range(row, self.size):
            if fits[place] and not (self.near[place] and self._back(place)):
                misses, end = 0, place + 1
            else:
                misses += 1
            if misses == 3 or (self.near[place] and self._back(place)):
                break
        return end - row if np.mean(fits[row:end] if end > row else [False]) > 0.7 else 0

    def _back(self, place: int) -> bool:
        """Whether the rows match again from `place` on: three consecutive ones do."""
        ahead = self.near[place : place + 3]
        return bool(len(ahead) == 3 and np.all(ahead))

    def _near(self, measured: Any, joints: Any) -> Any:
        """Which measurements belong to which rows' joints: pairs of rows (K,) each."""
        posture = self.block.postures.pick(joints)
        rows = self.block.pick(measured).changed(at=posture)
        return rows.errors(self.nominal.state) < self.nominal.limit_mm


def out_of_step(setup: Setup) -> Iterator[Hypothesis]:
    """Shifted rows corrected, with nominal registered on a part of them that is consistent; several sessions first one
    by one, then all of them as one hypothesis.
    """
    sessions = sorted({block.session for block in setup.task.rows.blocks if len(block)})
    if len(sessions) == 1:
        yield from _in_one_session(setup)
        return
    changes: list[Change] = []
    readings, complexity = setup.readings.copy(), 0
    for number in sessions:
        rows, alone = setup.session(number)
        judged = [(misfit(each.setup).with_prediction(each.setup).ratio, each) for each in _in_one_session(alone)]
        ratio, best = min(judged, key=lambda pair: (pair[0], pair[1].complexity), default=(np.inf, None))
        if best is not None and ratio <= EXPLAINED:
            changes += [_in_session(change, rows, setup.task.sessions[number].name) for change in best.changes]
            readings[rows], complexity = best.setup.readings, complexity + best.complexity
    if changes:
        yield Hypothesis(tuple(changes), setup.with_readings(readings), complexity)


def _in_session(change: Change, rows: Any, name: str) -> Change:
    """A change to the rows of a session, as one to all rows; `rows` (N,): indices of the session's rows."""
    what = change.what.replace("in all rows", f"in all rows of session {name}")
    return replace(change, what=what, rows=tuple(int(rows[row]) for row in change.rows))


def _in_one_session(setup: Setup) -> Iterator[Hypothesis]:
    for block, window in _windows(setup):
        for by in (0, *SHIFTS):
            trial = setup.pick(window)
            trial = trial if not by else _shifted_whole(trial, by)
            if len(trial.readings) < 2 * RUN:
                continue
            found = misfit(trial).with_prediction(trial)
            if found.ratio < 1.5:  # a consistent part
                yield from put_in_step(setup, found, only=block)


def put_in_step(setup: Setup, nominal: Misfit, only: int | None = None) -> Iterator[Hypothesis]:
    """Rows that are shifted or exchanged if `nominal`, registered on matching rows, is right."""
    changes: list[Change] = []
    order, start = np.arange(len(setup.readings)), 0
    blocks = setup.task.rows.blocks
    for number, block in enumerate(blocks):
        if len(block) >= 2 * RUN and only in (None, number):
            matches = RowMatches(block, nominal)
            stretches = matches.stretches()
            for stretch in stretches:
                rows = np.arange(stretch.first, stretch.last + 1)
                order[start + rows] = start + np.clip(rows - stretch.by, 0, len(block) - 1)
                changes.append(_step(stretch, start, len(block)))
            for first, second in matches.exchanged(stretches):
                order[start + first], order[start + second] = start + second, start + first
                changes.append(_exchange(start + first, start + second))
        start += len(block)
    if changes:
        inside = sum("to {1}" in change.what for change in changes)
        yield Hypothesis(tuple(changes), setup.with_readings(setup.readings[order]), 5 * len(changes) + inside)


def _windows(setup: Setup) -> Iterator[tuple[int, Any]]:
    """Each block whole, its first half and its last, as indices of the task's rows; 150 of each are enough."""
    start = 0
    for number, block in enumerate(setup.task.rows.blocks):
        count, half = len(block), len(block) // 2
        for first, end in ((0, count), (0, half), (half, count)):
            yield number, start + np.arange(first, min(end, first + 150))
        start += count


def _shifted_whole(setup: Setup, by: int) -> Setup:
    """All measurements at the joints of `by` rows before; rows without these are left out."""
    rows = np.arange(len(setup.readings))
    inside = (rows - by >= 0) & (rows - by < len(rows))
    return setup.pick(inside).with_readings(setup.readings[rows[inside] - by])


def _step(stretch: Stretch, start: int, size: int) -> Change:
    """In words; `size` rows in the block, which begins at row `start` of the task."""
    rows, at_end = (start + stretch.first, start + stretch.last), stretch.last >= size - 1 + min(stretch.by, 0)
    many = "the row" if abs(stretch.by) == 1 else f"{abs(stretch.by)} rows"
    belong = f"the measurements belong to the joints of {many} {'before' if stretch.by > 0 else 'after'}"
    if at_end and stretch.first <= max(stretch.by, 0):
        what = f"in all rows {belong}"
    else:
        what = f"from {{0}} on {belong}" if at_end else f"from {{0}} to {{1}} {belong}"
    cure = "a joint reading or a measurement is missing there, or was taken twice: put the two in step again"
    return Change(what, "data", cure, rows=rows)


def _exchange(first: int, second: int) -> Change:
    what = "the measurements of {0} and {1} are exchanged"
    return Change(what, "data", "exchange them", rows=(first, second))


def count_outliers(setup: Setup, nominal: Misfit) -> int:
    """How many rows are outliers to `nominal`."""
    first = setup.pick(np.arange(min(len(setup.readings), MOST)))
    return int(np.count_nonzero(distances(first, nominal.state) >= nominal.limit_mm))
