"""One RSI session by its counts: which telegrams may be answered, and whether the last answer was taken."""

from __future__ import annotations

from enum import Enum, auto
from typing import final

from drivers.kuka_rsi.cyclic.cycle_timing import CYCLES_MS, CycleTiming
from drivers.kuka_rsi.cyclic.telegram import Telegram

DEFAULT_TOLERANCE = 100
"""Cycles without an answer after which the ETHERNET object stops, the `Timeout` of most contexts."""


class Admission(Enum):
    """How a telegram is treated."""

    ANSWERABLE = auto()
    STALE = auto()
    """Its count is not greater than the last: a duplicate, or overtaken in transit."""
    BEYOND = auto()
    """Its count lies further from the last answer than the controller tolerates, or the session is over."""


@final
class Session:
    """The telegrams of one RSI session, in the order of their counts.

    `over`: no telegram is answered any more; `over_by`: the rise of the count that ended it.

    An answer is taken if the next telegram is the next cycle's and its Delay has not risen. That holds whether or not
    a valid answer resets the count. After a missing cycle there is no conclusion.
    """

    def __init__(self, tolerance_cycles: int = DEFAULT_TOLERANCE) -> None:
        self.timing = CycleTiming()
        self.over = False
        self.over_by = 0
        self._tolerance = tolerance_cycles
        self._newest: int | None = None
        self._answered: Telegram | None = None

    def admit(self, telegram: Telegram) -> Admission:
        """Whether `telegram` may be answered; a gap beyond the tolerance ends the session permanently."""
        if self.over:
            return Admission.BEYOND
        if self._newest is not None:
            if telegram.ipoc <= self._newest:
                return Admission.STALE
            self._look_at_gap(telegram.ipoc, self._newest)
        if not self.over:
            self._newest = telegram.ipoc
        return Admission.BEYOND if self.over else Admission.ANSWERABLE

    def answering(self, telegram: Telegram, now_ns: int) -> tuple[int, bool]:
        """`telegram` is about to be answered: cycles since the last one that was, and whether that answer was taken.

        While the cycle is learnt every answer is zero, and each counts as taken.
        """
        before, self._answered = self._answered or telegram, telegram
        in_time = (telegram.delay or 0) <= (before.delay or 0)
        if self.timing.learnt:
            gap = self.timing.gap(before.ipoc, telegram.ipoc)
            return gap, gap == 1 and in_time
        self.timing.learn(telegram.ipoc, now_ns, nothing_lost=in_time)
        return 1, True

    def _look_at_gap(self, ipoc: int, newest: int) -> None:
        step = self.timing.ipoc_step or max(CYCLES_MS)
        last = self._answered.ipoc if self._answered else newest
        wrong_cycle = self.timing.learnt and self.timing.gap(newest, ipoc) < 1
        if ipoc - last > self._tolerance * step or wrong_cycle:
            self.over, self.over_by = True, ipoc - last
