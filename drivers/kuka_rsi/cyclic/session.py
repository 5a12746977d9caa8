"""One RSI session by its counts: which telegrams may be answered, and whether the last answer was taken.

A controller may end RSI and switch it on again while the PC is silent: its count goes on, its UDP port may be the same,
and its zero is where the robot stands. An answer meant for the session before would then move the robot by the whole
correction in one cycle. What a telegram shows of it is Delay, the controller's count of cycles without an answer.

Let a be the last telegram that was answered and n a later one, g = n - a cycles. Its answer was taken in one cycle at
most, and no other cycle had an answer, so in one session Delay(n) ≥ g - 1, whether or not an answer that was taken
resets the count. In a session that began at s = a + r, Delay(n) ≤ n - s = g - r. So Delay(n) ≥ g - 1 - `_LAG` shows
that r ≤ 1 + `_LAG`: a restart after three cycles or more is seen, one after one or two is not. Where an answer that was
taken is seen not to reset the count, Delay(n) - Delay(a) ≥ g - 1 - `_LAG` is asked for: after a lost answer that shows
the shorter restarts, too.
"""

from __future__ import annotations

from enum import Enum, auto
from typing import final

from drivers.kuka_rsi.cyclic.cycle_timing import CYCLES_MS, CycleTiming, InterpolationCycle
from drivers.kuka_rsi.cyclic.telegram import Telegram

DEFAULT_TOLERANCE = 100
"""Cycles without an answer after which the ETHERNET object stops, the `Timeout` of most contexts."""

LONGEST_TOLERANCE_MS = 500
"""Highest tolerance, in any mode and cycle: the longer the silence, the more can have happened at the controller."""

_LAG = 1
"""Cycles by which a telegram's Delay may be behind its count [U: 0 on both simulators]."""


def highest_tolerance(cycle: InterpolationCycle) -> int:
    """The highest tolerance, in cycles: 125 at 4 ms, 41 at 12 ms."""
    return LONGEST_TOLERANCE_MS // cycle.milliseconds


def default_tolerance(cycle: InterpolationCycle) -> int:
    """The tolerance of an address that states none, in cycles: 100 at 4 ms, 41 at 12 ms."""
    return min(DEFAULT_TOLERANCE, highest_tolerance(cycle))


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

    `over`: no telegram is answered any more; `over_by`: the rise of the count that ended it; `restarted`: it was ended
    because the controller has begun another one, or nothing shows that it has not.

    An answer is taken if the next telegram is the next cycle's and its Delay has not risen. That holds whether or not
    a valid answer resets the count. After a missing cycle there is no conclusion.
    """

    def __init__(self, tolerance_cycles: int = DEFAULT_TOLERANCE) -> None:
        self.timing = CycleTiming()
        self.over = False
        self.over_by = 0
        self.restarted = False
        self._tolerance = tolerance_cycles
        self._newest: Telegram | None = None
        self._answered: Telegram | None = None
        self._counts_all = False  # Delay counts all cycles without an answer, not those since the last

    def admit(self, telegram: Telegram) -> Admission:
        """Whether `telegram` may be answered; a gap beyond the tolerance, or another session, ends this one."""
        if self.over:
            return Admission.BEYOND
        newest = self._newest
        if newest is not None:
            if telegram.ipoc <= newest.ipoc:
                return Admission.STALE
            self._look_at_gap(telegram.ipoc, newest.ipoc)
            if not self.over and self._is_of_another(telegram, newest):
                self.end(telegram)
        if not self.over:
            self._newest = telegram
        return Admission.BEYOND if self.over else Admission.ANSWERABLE

    def answering(self, telegram: Telegram, now_ns: int) -> tuple[int, bool]:
        """`telegram` is about to be answered: cycles since the last one that was, and whether that answer was taken.

        While the cycle is learnt every answer is zero, and each counts as taken.
        """
        before, self._answered = self._answered or telegram, telegram
        in_time = (telegram.delay or 0) <= (before.delay or 0)
        if self.timing.learnt:
            gap = self.timing.gap(before.ipoc, telegram.ipoc)
            taken = gap == 1 and in_time
            self._counts_all |= taken and bool(telegram.delay) and telegram.delay == before.delay
            return gap, taken
        self.timing.learn(telegram.ipoc, now_ns, nothing_lost=in_time)
        return 1, True

    def end(self, telegram: Telegram) -> None:
        """`telegram` shows, or does not refute, that the controller has begun another session."""
        since = self._answered or self._newest or telegram
        self.over, self.restarted, self.over_by = True, True, telegram.ipoc - since.ipoc

    def _is_of_another(self, telegram: Telegram, newest: Telegram) -> bool:
        """By the mark that the controller's program gives its sessions; without one, by Delay; without, by any gap.

        While the cycle is learnt nothing was corrected: answers are zero in either session.
        """
        if telegram.mark or newest.mark:
            return telegram.mark != newest.mark
        if not self.timing.learnt or self._answered is None:
            return False
        without_answer = self.timing.gap(self._answered.ipoc, telegram.ipoc) - 1
        if telegram.delay is None:
            return without_answer > 0
        risen_from = (self._answered.delay or 0) if self._counts_all else 0
        return telegram.delay - risen_from < without_answer - _LAG

    def _look_at_gap(self, ipoc: int, newest: int) -> None:
        step = self.timing.ipoc_step or max(CYCLES_MS)
        last = self._answered.ipoc if self._answered else newest
        wrong_cycle = self.timing.learnt and self.timing.gap(newest, ipoc) < 1
        if ipoc - last > self._tolerance * step or wrong_cycle:
            self.over, self.over_by = True, ipoc - last
