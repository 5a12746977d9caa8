"""Cycle timing, from the controller's count and the arrivals: cycle length, lost telegrams, late answers."""

from __future__ import annotations

import itertools
from enum import StrEnum
from statistics import median
from typing import final

LEARNING_TELEGRAMS = 8
"""Telegrams of a session that are answered with zero while its cycle is learnt."""

_MS = 1_000_000


@final
class InterpolationCycle(StrEnum):
    """The cycle with which the controller's program switches RSI on; the address must agree."""

    IPO_FAST = "ipo_fast"
    """4 ms."""

    IPO = "ipo"
    """12 ms."""

    @property
    def milliseconds(self) -> int:
        """Its length."""
        return 4 if self is InterpolationCycle.IPO_FAST else 12

    def fits(self, cycle_ns: int) -> bool:
        """Whether the learnt cycle `cycle_ns` is this one, within a half: arrivals alone tell it that well."""
        return 2 * abs(cycle_ns - self.milliseconds * _MS) <= self.milliseconds * _MS


CYCLES_MS = tuple(cycle.milliseconds for cycle in InterpolationCycle)

_WINDOW = 128
"""Telegrams in each of the two windows of the least delay; at 4 ms, 300 ppm of drift are 0.3 ms in both."""


@final
class CycleTiming:
    """Learns one session's cycle from its first telegrams.

    KUKA counts milliseconds, 4 or 12 a cycle; some simulators count telegrams. A step of 1 leaves the length to the
    median of the arrivals, rounded to whole milliseconds. With any other step, telegrams were lost: more are used.
    `ipoc_step`: count per cycle; `cycle_ns`: its length in the cell's time; both 0 until learnt.
    """

    def __init__(self) -> None:
        self.ipoc_step = 0
        self.cycle_ns = 0
        self._seen: list[tuple[int, int]] = []

    @property
    def learnt(self) -> bool:
        """Whether the cycle is known."""
        return self.cycle_ns > 0

    def learn(self, ipoc: int, arrival_ns: int, *, nothing_lost: bool = True) -> None:
        """Add one of the first telegrams, by count; restart if cycles were lost."""
        if not nothing_lost:
            self._seen.clear()
        self._seen.append((ipoc, arrival_ns))
        del self._seen[:-LEARNING_TELEGRAMS]
        if len(self._seen) >= LEARNING_TELEGRAMS:
            self._conclude()

    def gap(self, before: int, now: int) -> int:
        """Cycles from one count to the next: 1 if none was lost, 0 if the learnt cycle is wrong."""
        return round((now - before) / self.ipoc_step)

    def _conclude(self) -> None:
        pairs = [(b[0] - a[0], b[1] - a[1]) for a, b in itertools.pairwise(self._seen)]
        step = min(count for count, _ in pairs)
        if step in CYCLES_MS:
            self.ipoc_step, self.cycle_ns = step, step * _MS
        elif step == 1:
            arrivals_ms = median(ns for count, ns in pairs if count == 1) / _MS
            self.ipoc_step, self.cycle_ns = 1, max(1, round(arrivals_ms)) * _MS


@final
class AnswerDelay:
    """Time from a telegram's departure to its answer, by the smallest recent delay.

    The clocks' offset is unknown, so the fastest telegram of the last one or two windows counts as having no delay.
    """

    def __init__(self) -> None:
        self._least: int | None = None
        self._least_before: int | None = None
        self._count = 0

    def arrived(self, sent_ns: int, arrival_ns: int) -> None:
        """A telegram stamped `sent_ns` by the controller was read at `arrival_ns` of the cell's time."""
        if self._count == _WINDOW:
            self._least, self._least_before, self._count = None, self._least, 0
        delay = arrival_ns - sent_ns
        self._least = delay if self._least is None else min(self._least, delay)
        self._count += 1

    def of(self, sent_ns: int, answered_ns: int) -> int:
        """Nanoseconds from the telegram's departure to its answer."""
        known = [least for least in (self._least, self._least_before) if least is not None]
        return answered_ns - sent_ns - min(known)
