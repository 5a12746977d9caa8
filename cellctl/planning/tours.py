"""The order of touches, and the paths between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self, final

import numpy as np
from numpy.typing import NDArray

from cellctl.planning.ways import Ways

Array = NDArray[np.float64]

_NEAREST = 8
"""How many of the nearest touches are tried as the next one, before a return home."""


@final
@dataclass(frozen=True, slots=True)
class PlannedTouch:
    """One touch: joint readings in degrees.

    `origin`: where the last touch ended, or home; `approach`: from there to clear of the sphere; `start`, `end`: of the
    search; `search_mm`: the tip's way between them by the nominal model; `retreat`: back to `start`, to clear of the
    sphere, and home after the last one. `reference`: it repeats an earlier touch, to see what has changed since.
    """

    sphere: str
    origin: tuple[float, ...]
    approach: tuple[tuple[float, ...], ...]
    start: tuple[float, ...]
    end: tuple[float, ...]
    search_mm: float
    retreat: tuple[tuple[float, ...], ...]
    reference: bool = False


@final
@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A touch whose own ways are clear, not yet part of a tour; joint readings (n,), deg."""

    sphere: str
    clear: Array
    start: Array
    end: Array
    search_mm: float
    reference: bool = False

    @classmethod
    def of(cls, touch: PlannedTouch) -> Self:
        """A touch of another tour, to be fitted into this one."""
        start, clear = (np.array(q) for q in touch.retreat[:2])
        return cls(touch.sphere, clear, start, np.array(touch.end), touch.search_mm)


def ordered(candidates: Sequence[Candidate], ways: Ways, home: Array) -> list[Candidate]:
    """From home, always next the nearest that can be reached directly; the nearest of all where none can."""
    tour: list[Candidate] = []
    left, here = list(candidates), home
    while left:
        left.sort(key=lambda c: float(np.abs(c.clear - here).max()))
        near = next((i for i, c in enumerate(left[:_NEAREST]) if ways.clear(here, c.clear)), 0)
        tour.append(left.pop(near))
        here = tour[-1].clear
    return tour


def with_references(tour: Sequence[Candidate], every: int, reference: Candidate) -> list[Candidate]:
    """`tour` with a return to `reference` after each `every` touches."""
    again = replace(reference, reference=True)
    parts = [list(tour[first : first + every]) for first in range(0, len(tour), every)]
    return [touch for part in parts for touch in ([*part, again] if len(part) == every else part)]


def linked(tour: Sequence[Candidate], ways: Ways, home: Array) -> list[PlannedTouch]:
    """`tour` with its ways: from one touch to the next directly where that is clear, over home where it is not."""
    planned: list[PlannedTouch] = []
    here = home
    for number, touch in enumerate(tour, 1):
        approach = [touch.clear] if ways.clear(here, touch.clear) else [home, touch.clear]
        retreat = [touch.start, touch.clear, *([home] if number == len(tour) else [])]
        planned.append(
            PlannedTouch(
                touch.sphere,
                _row(here),
                tuple(_row(q) for q in approach),
                _row(touch.start),
                _row(touch.end),
                touch.search_mm,
                tuple(_row(q) for q in retreat),
                touch.reference,
            )
        )
        here = touch.clear
    return planned


def _row(readings: Array) -> tuple[float, ...]:
    return tuple(round(float(a), 4) for a in readings)
