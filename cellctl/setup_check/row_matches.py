"""Which measurements belong to which rows' joints: runs of shifted rows, and pairs of exchanged rows."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from cellctl.calibration.rows import Measured
from cellctl.setup_check.misfit import Misfit

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
