"""One RSI session: cycle timing, which telegrams may be answered, and the interface and state of its task.

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

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum, IntEnum, StrEnum, auto
from statistics import median
from typing import Protocol, final

from drivers.kuka_rsi import AXES
from drivers.kuka_rsi.cyclic.limits import Correction
from drivers.kuka_rsi.cyclic.telegram import Telegram

LEARNING_TELEGRAMS = 8
"""Telegrams of a session that are answered with zero while its cycle is learnt: 32 ms at 4 ms, 96 ms at 12 ms.

The cycle is the least of the seven rises of the count, so it is found if only one of them is free of a lost telegram.
"""

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
"""Telegrams in each of the two windows of the least delay: long enough that one in each comes without waiting, short
enough that the clocks do not drift apart; at 4 ms, 300 ppm are 0.3 ms in both."""


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
        """A telegram stamped `sent_ns` by the controller was read at `arrival_ns` of the cell's time.

        sent_ns: IPOC × T / step, ns of the controller's clock, whose zero is unknown: only differences are used.
        """
        if self._count == _WINDOW:
            self._least, self._least_before, self._count = None, self._least, 0
        delay = arrival_ns - sent_ns
        self._least = delay if self._least is None else min(self._least, delay)
        self._count += 1

    def of(self, sent_ns: int, answered_ns: int) -> int:
        """Nanoseconds from the telegram's departure to its answer."""
        known = [least for least in (self._least, self._least_before) if least is not None]
        return answered_ns - sent_ns - min(known)


DEFAULT_TOLERANCE = 100
"""Cycles without an answer after which the ETHERNET object stops, the `Timeout` of most published contexts (KUKA's own
default is 10: an address then states `tolerance=10`)."""

LONGEST_TOLERANCE_MS = 500
"""Highest tolerance, in any mode and cycle: the longer the silence, the more can have happened at the controller."""

_LAG = 1
"""Cycles by which a telegram's Delay may be behind its count. Not known of a KRC; 0 in both public simulators. The
experiment: docs/connecting-a-krc.md, *A session that ends and begins anew*."""


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
        # before the cycle is learnt the longest one: a gap that is too long does no harm while every answer is zero
        step = self.timing.ipoc_step or max(CYCLES_MS)
        last = self._answered.ipoc if self._answered else newest
        wrong_cycle = self.timing.learnt and self.timing.gap(newest, ipoc) < 1
        if ipoc - last > self._tolerance * step or wrong_cycle:
            self.over, self.over_by = True, ipoc - last


class Phase(IntEnum):
    """Phase of a search; of an on-line correction see `OnlineCorrection`.

    LEARNING: the cycle is not known, every answer is zero. MOVING: along the line. BRAKING: one telegram, half of the
    last step. SETTLING: the set-point is constant until the joints stand. LEAVING: the same with the stop set, until
    the controller has left RSI. OVER: no telegram is answered; the robot is where the controller holds it.
    """

    IDLE = 0
    LEARNING = 1
    MOVING = 2
    BRAKING = 3
    SETTLING = 4
    LEAVING = 5
    OVER = 6


class Cause(IntEnum):
    """Why the set-point was stopped.

    STOPPED: the stop slot, a contact as a rule. TRAVEL: the end of the line, or of a correction by request. GUARD: a
    guard's beat is too old. LIMIT: the next set-point would pass one. START: the pose at RSI_ON is not the planned one.
    LOST: the count rose by more than the tolerance. LEFT: the process has to end. BEHIND, AHEAD: the joints do not
    follow. CYCLE: the learnt cycle is not the address's.
    """

    NONE = 0
    STOPPED = 1
    TRAVEL = 2
    GUARD = 3
    LIMIT = 4
    START = 5
    LOST = 6
    LEFT = 7
    BEHIND = 8
    AHEAD = 9
    CYCLE = 10
    UNKNOWN = 11
    """On-line correction: a telegram without the programmed joints or the count of late answers."""
    MODEL = 12
    """On-line correction: no valid model."""
    NOT_TAKEN = 13
    """On-line correction: for as many telegrams as the controller tolerates, no answer was known to be taken."""
    RESTARTED = 14
    """The controller has ended RSI and switched it on again, or nothing shows that it has not."""
    OVER_LIMIT = 15
    """On-line correction: the model's correction is over the limit in the whole measured region."""


@final
@dataclass(frozen=True, slots=True)
class SearchOrder:
    """An order to the cyclic process: a search; or, with correction 0, telegrams at rest or an on-line correction.

    `start`: the joints from which the line was planned; `correction`: offset at its end, degrees; `speed_deg_s`;
    `guards_ns`: oldest beat allowed per guard slot, 0 if the slot is unused; `hold_cycles`: least telegrams answered
    at the end of the line.
    """

    number: int
    start: tuple[float, ...]
    correction: Correction
    speed_deg_s: float
    guards_ns: tuple[int, ...]
    hold_cycles: int = 0


class CyclicTask(Protocol):
    """The answers to the controller's telegrams from one order until its release, in one RSI session.

    Pure: telegrams, time and slots in, corrections out; within the cycle. `number`: of the order; `cause`, `detail` and
    `age_ns`: why it ended; `stop_cycles` counts the telegrams answered from the first with the stop known to the
    first with a constant set-point, both included; `missed`: telegrams not answered, by the controller's count.
    """

    number: int
    phase: Phase
    cause: Cause
    detail: int
    age_ns: int
    stop_cycles: int
    missed: int

    @property
    def timing(self) -> CycleTiming:
        """The cycle of the session."""

    def admit(self, telegram: Telegram) -> Admission:
        """Whether `telegram` may be answered. Otherwise it is only counted."""

    def answer(
        self, telegram: Telegram, now_ns: int, stopped: bool, beats: Sequence[int], *, leave: bool = False
    ) -> tuple[Correction, bool]:
        """The corrections (offsets or increments, by the mode) and the stop to answer an admitted `telegram` with.

        `stopped`: the stop slot names this order; `beats`: last beat per guard slot, ns of the cell's time; `leave`:
        the process must end.
        """


class SessionTask:
    """The common part of the CyclicTasks of one RSI session: attributes as there."""

    def __init__(self, order: SearchOrder, tolerance_cycles: int, cycle: InterpolationCycle) -> None:
        self.number = order.number
        self.order = order
        self.phase = Phase.LEARNING
        self.cause = Cause.NONE
        self.detail = 0
        self.age_ns = 0
        self.stop_cycles = 0
        self.missed = 0
        self._session = Session(tolerance_cycles)
        self._cycle = cycle
        self._began_ns: int | None = None
        self._sent: Correction = (0.0,) * AXES

    @property
    def timing(self) -> CycleTiming:
        """The cycle of the session."""
        return self._session.timing

    def admit(self, telegram: Telegram) -> Admission:
        """Whether `telegram` may be answered. Otherwise it is only counted."""
        admission = self._session.admit(telegram)
        if self._session.over and self.phase is not Phase.OVER:
            self.cause = Cause.RESTARTED if self._session.restarted else Cause.LOST
            self.detail, self.phase = self._session.over_by, Phase.OVER
        return admission

    def _guard_is_silent(self, now_ns: int, beats: Sequence[int]) -> bool:
        """Whether a guard's beat is too old; `detail` and `age_ns` are the first such guard's then.

        The age counts from the task's start at the earliest, even without an earlier beat: a device that reports only
        while it is armed has its full time for the first beat.
        """
        for slot, oldest_ns in enumerate(self.order.guards_ns):
            age_ns = now_ns - max(beats[slot], self._began_ns or 0)
            if 0 < oldest_ns < age_ns:
                self.detail, self.age_ns = slot, age_ns
                return True
        return False
