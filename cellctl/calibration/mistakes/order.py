"""Rows out of step: measurements that belong to the joints of a row before or after, from some row on; two exchanged.

A robot that is registered on rows that are in step says of every other row to whose joints its measurement belongs.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np

from cellctl.calibration.mistakes.case import Case
from cellctl.calibration.mistakes.misfit import EXPLAINED, Misfit, misfit, row_errors
from cellctl.calibration.mistakes.supposition import Change, Supposition
from cellctl.calibration.model.unknowns import State

FURTHEST = 5
"""Rows by which measurements and joints may be out of step."""

RUN = 4
"""Rows in a row that have to be out of step alike: fewer may lie so by chance."""

FAR = 8.0
"""Times the foreseen distance from which on a row is not where the model says."""

MOST = 20_000
"""Rows that are looked at, the first; beyond, a shift is the same from there on."""

EXCHANGED_AT_MOST = 100
"""Wild rows among which pairs are looked for."""


@final
@dataclass(frozen=True, slots=True)
class Stretch:
    """Rows first … last of a block whose measurements belong to the joints `by` rows before (negative: after)."""

    first: int
    last: int
    by: int


def out_of_step(case: Case) -> Iterator[Supposition]:
    """Rows put back in step, with nominal registered on a part of them that is in step with itself; of several sessions
    each by itself, then all of them as one supposition.
    """
    sessions = sorted({block.session for block in case.task.rows.blocks if len(block)})
    if len(sessions) == 1:
        yield from _in_one_session(case)
        return
    changes: list[Change] = []
    readings, oddity = case.readings.copy(), 0
    for number in sessions:
        rows, alone = case.session(number)
        judged = [(misfit(each.case).foreseen(each.case).times, each) for each in _in_one_session(alone)]
        times, best = min(judged, key=lambda pair: (pair[0], pair[1].oddity), default=(np.inf, None))
        if best is not None and times <= EXPLAINED:
            changes += [_in_session(change, rows, case.task.sessions[number].name) for change in best.changes]
            readings[rows], oddity = best.case.readings, oddity + best.oddity
    if changes:
        yield Supposition(tuple(changes), case.with_readings(readings), oddity)


def _in_session(change: Change, rows: Any, name: str) -> Change:
    """A change to the rows of a session, as one to the rows of all; `rows` (N,): where those of the session are."""
    what = change.what.replace("in all rows", f"in all rows of session {name}")
    return replace(change, what=what, rows=tuple(int(rows[row]) for row in change.rows))


def _in_one_session(case: Case) -> Iterator[Supposition]:
    for block, window in _windows(case):
        for by in (0, *_shifts()):
            trial = case.pick(window)
            trial = trial if not by else _shifted_whole(trial, by)
            if len(trial.readings) < 2 * RUN:
                continue
            found = misfit(trial).foreseen(trial)
            if found.times < 1.5:  # a part in step with itself
                yield from put_in_step(case, found, only=block)


def put_in_step(case: Case, nominal: Misfit, only: int | None = None) -> Iterator[Supposition]:
    """What lies out of step or exchanged where `nominal`, registered on rows that are in step, is right."""
    changes: list[Change] = []
    order, start = np.arange(len(case.readings)), 0
    limit = FAR * max(nominal.foreseen_mm, nominal.mm)
    blocks = case.task.rows.blocks
    for number, block in enumerate(blocks):
        if len(block) >= 2 * RUN and only in (None, number):
            lost = _Block(case, number, nominal.state, limit)
            stretches = lost.stretches()
            for stretch in stretches:
                rows = np.arange(stretch.first, stretch.last + 1)
                order[start + rows] = start + np.clip(rows - stretch.by, 0, len(block) - 1)
                changes.append(_step(stretch, start, len(block)))
            for first, second in lost.exchanged(stretches):
                order[start + first], order[start + second] = start + second, start + first
                changes.append(_exchange(start + first, start + second))
        start += len(block)
    if changes:
        inside = sum("to {1}" in change.what for change in changes)
        yield Supposition(tuple(changes), case.with_readings(case.readings[order]), 5 * len(changes) + inside)


class _Block:
    """One block of rows, and how far each measurement is from the robot at other rows' joints."""

    def __init__(self, case: Case, number: int, state: State, limit: float) -> None:
        self.block = case.task.rows.blocks[number].pick(np.s_[:MOST])
        self.case, self.state, self.limit = case, state, limit
        self.size = len(self.block)
        self.near = self._near(np.arange(self.size), np.arange(self.size))

    def stretches(self) -> list[Stretch]:
        """Runs of wild rows that all belong to joints equally far before or behind."""
        if np.count_nonzero(~self.near) < RUN:
            return []
        rows = np.arange(self.size)
        best: dict[int, Any] = {}
        for by in _shifts():
            inside = (rows - by >= 0) & (rows - by < self.size)
            fits = np.zeros(self.size, bool)
            fits[inside] = self._near(rows[inside], rows[inside] - by)
            best[by] = fits
        return list(self._runs(best))

    def exchanged(self, stretches: list[Stretch]) -> list[tuple[int, int]]:
        """Pairs of wild rows that are each right at the other's joints."""
        taken = {row for stretch in stretches for row in range(stretch.first, stretch.last + 1)}
        wild = [int(row) for row in np.flatnonzero(~self.near) if row not in taken]
        if not 2 <= len(wild) <= EXCHANGED_AT_MOST:
            return []
        pairs = np.array(list(itertools.combinations(wild, 2)))
        both = self._near(pairs[:, 0], pairs[:, 1]) & self._near(pairs[:, 1], pairs[:, 0])
        result: list[tuple[int, int]] = []
        for first, second in pairs[both].tolist():
            if not {first, second} & {row for pair in result for row in pair}:
                result.append((first, second))
        return result

    def _runs(self, fits: dict[int, Any]) -> Iterator[Stretch]:
        """Greedily from the first row: the shift that explains most of what follows; single rows may be wild anyway."""
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
        """How many rows from `row` on a shift explains, better than no shift does; two misses in a row end it."""
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
        """Whether the rows are in step again from `place` on: three in a row are."""
        ahead = self.near[place : place + 3]
        return bool(len(ahead) == 3 and np.all(ahead))

    def _near(self, measured: Any, joints: Any) -> Any:
        """Which measurements belong to which rows' joints: pairs of rows (K,) each."""
        posture = self.block.postures.pick(joints)
        rows = self.block.pick(measured).changed(at=posture)
        return rows.errors(self.state) < self.limit


def _shifts() -> list[int]:
    return sorted((by for by in range(-FURTHEST, FURTHEST + 1) if by), key=abs)


def _windows(case: Case) -> Iterator[tuple[int, Any]]:
    """Each block whole, its first half and its last, as indices of the task's rows; 150 of each are enough."""
    start = 0
    for number, block in enumerate(case.task.rows.blocks):
        count, half = len(block), len(block) // 2
        for first, end in ((0, count), (0, half), (half, count)):
            yield number, start + np.arange(first, min(end, first + 150))
        start += count


def _shifted_whole(case: Case, by: int) -> Case:
    """All measurements at the joints of `by` rows before; rows without such are left out."""
    rows = np.arange(len(case.readings))
    inside = (rows - by >= 0) & (rows - by < len(rows))
    return case.pick(inside).with_readings(case.readings[rows[inside] - by])


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


def wild_rows(case: Case, nominal: Misfit) -> int:
    """How many rows are not where `nominal` says, though most are."""
    limit = FAR * max(nominal.foreseen_mm, nominal.mm)
    first = case.pick(np.arange(min(len(case.readings), MOST)))
    return sum(int(np.count_nonzero(mm >= limit)) for mm, _ in row_errors(first.task, nominal.state))
