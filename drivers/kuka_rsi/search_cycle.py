"""One search, cycle by cycle: what to answer to each telegram. Pure: telegrams, time and slots in, corrections out."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import final

from drivers.kuka_rsi.correction_mode import CorrectionMode, WrittenCorrections
from drivers.kuka_rsi.cycle_timing import CycleTiming
from drivers.kuka_rsi.limits import AXES, Correction, CycleWatch, Limit, SearchLimits
from drivers.kuka_rsi.set_point import SetPoint
from drivers.kuka_rsi.telegram import Telegram

_STANDING_DEG = 0.001
"""Joints that stay within this span over `_STANDING_CYCLES` stand still (twice a common encoder's step)."""

_STANDING_CYCLES = 10

_SHORTEST_HOLD_S = 0.06
_LONGEST_HOLD_S = 1.0

_LONGEST_PAUSE_NS = 1_000_000_000
"""After a longer gap in the controller's count it has left RSI meanwhile, and was switched on anew."""

_START_TOLERANCE_DEG = 0.1
"""The pose at RSI_ON may differ by this from the one that the search was planned from."""

_FARTHEST_AHEAD_DEG = 0.25
"""Joints further than this ahead of the set-point run away: no servo leads, and a telegram may show 0.1 deg steps."""

_FARTHEST_BEHIND_DEG = 1.0
"""Joints further than this behind the set-point do not follow; a servo's lag at the speeds allowed is a third of it."""


class Phase(IntEnum):
    """Where a search is."""

    IDLE = 0
    LEARNING = 1
    MOVING = 2
    BRAKING = 3
    SETTLING = 4
    LEAVING = 5


class Cause(IntEnum):
    """Why the set-point was brought to a stand."""

    NONE = 0
    STOPPED = 1
    TRAVEL = 2
    GUARD = 3
    LIMIT = 4
    START = 5
    RESTARTED = 6
    LEFT = 7
    BEHIND = 8
    AHEAD = 9


@final
@dataclass(frozen=True, slots=True)
class SearchOrder:
    """What is asked of the cyclic process.

    `start`: the joints from which the line was planned; `correction`: offset at its end, degrees; `speed_deg_s`;
    `guards_ns`: oldest beat allowed per guard slot, 0 where the slot guards nothing.
    """

    number: int
    start: tuple[float, ...]
    correction: Correction
    speed_deg_s: float
    guards_ns: tuple[int, ...]


@final
class SearchCycle:
    """State of one search.

    `cause`, `detail` (guard slot, or which limit) and `age_ns` (of the guard) say why it ended; `stop_cycles` counts
    the telegrams answered from the first with the stop known to the first whose set-point stood still, both included;
    `missed` the telegrams that were not answered, by the controller's count.
    """

    def __init__(
        self, order: SearchOrder, limits: SearchLimits, mode: CorrectionMode = CorrectionMode.ABSOLUTE
    ) -> None:
        self.order = order
        self.phase = Phase.LEARNING
        self.cause = Cause.NONE
        self.detail = 0
        self.age_ns = 0
        self.stop_cycles = 0
        self.missed = 0
        self.timing = CycleTiming()
        self._limits = limits
        self._began_ns: int | None = None
        self._ipoc = 0
        self._reported_late = 0
        self._late_in_a_row = 0
        self._start = order.start
        self._sent: Correction = (0.0,) * AXES
        self._mode = mode
        self._written = WrittenCorrections(mode)
        self._held_cycles = 0
        self._stood_by_stop = False
        self._recent: deque[tuple[float, ...]] = deque(maxlen=_STANDING_CYCLES)

    def answer(
        self, telegram: Telegram, now_ns: int, stopped: bool, beats: Sequence[int], *, leave: bool = False
    ) -> tuple[Correction, bool]:
        """The corrections (offsets or increments, by the mode) and the stop to answer `telegram` with.

        `stopped`: the stop slot names this search; `beats`: last beat per guard slot, ns of the cell's time; `leave`:
        the process must end.
        """
        gap = self._take_in(telegram, now_ns)
        self._look_for_trouble(now_ns, stopped, beats, leave)
        self._look_whether_it_follows(telegram.joints)
        before = self._sent
        self._count_late_in_a_row(telegram)
        self._move(gap)
        self._count_stop(stopped, before)
        self._settle(telegram.joints)
        return self._written.leading_to(self._sent), self.phase is Phase.LEAVING

    def _take_in(self, telegram: Telegram, now_ns: int) -> int:
        """The cycles since the last telegram answered; learns the cycle first."""
        if self._began_ns is None:
            self._began_ns, self._ipoc = now_ns, telegram.ipoc
            self._reported_late = telegram.delay or 0
            self._check_start(telegram.joints)
        before, self._ipoc = self._ipoc, telegram.ipoc
        if not self.timing.learnt:
            self.timing.learn(telegram.ipoc, now_ns)
            if self.timing.learnt:
                self._get_ready()
            return 1
        gap = self.timing.gap(before, telegram.ipoc)
        if telegram.ipoc < before or gap * self.timing.cycle_ns > _LONGEST_PAUSE_NS:
            self._restarted()
            return 1
        if self.phase is not Phase.LEAVING:
            self.missed += max(0, gap - 1)
        return gap

    def _check_start(self, joints: tuple[float, ...]) -> None:
        away = max(abs(a - b) for a, b in zip(joints, self.order.start, strict=True))
        self._start = joints
        if away > _START_TOLERANCE_DEG:
            self._end(Cause.START)

    def _get_ready(self) -> None:
        cycle_s = self.timing.cycle_ns * 1e-9
        self._watch = CycleWatch(self._limits, cycle_s)
        self._set_point = SetPoint(self.order.correction, self.order.speed_deg_s, self._limits, cycle_s)
        if self.phase is Phase.LEARNING:
            self.phase = Phase.MOVING

    def _restarted(self) -> None:
        """The controller counts anew: corrections now refer to another pose, and only zero is safe, in either mode."""
        if self.cause is Cause.NONE:
            self._end(Cause.RESTARTED)
        self.phase, self._sent = Phase.LEAVING, (0.0,) * AXES
        self._written = WrittenCorrections(self._mode)

    def _look_for_trouble(self, now_ns: int, stopped: bool, beats: Sequence[int], leave: bool) -> None:
        if stopped and self.cause in (Cause.NONE, Cause.TRAVEL):
            self._end(Cause.STOPPED)
        if self.cause is Cause.NONE and leave:
            self._end(Cause.LEFT)
        if self.cause is Cause.NONE:
            self._look_at_guards(now_ns, beats)

    def _look_whether_it_follows(self, joints: tuple[float, ...]) -> None:
        """Corrections that the controller does not take must not pile up: taken at last, they would be one leap."""
        lead = tuple(joint - a - b for joint, a, b in zip(joints, self._start, self._sent, strict=True))
        if self.phase is not Phase.LEAVING and self._along_the_line(lead) > _FARTHEST_AHEAD_DEG:
            self._run_away()
        elif self.cause is Cause.NONE and max(map(abs, lead)) > _FARTHEST_BEHIND_DEG:
            self._end(Cause.BEHIND)

    def _along_the_line(self, offset: Correction) -> float:
        line = self.order.correction
        return sum(a * b for a, b in zip(offset, line, strict=True)) / (math.hypot(*line) or 1.0)

    def _run_away(self) -> None:
        """The controller sums up offsets: holding would be going on, so it leaves RSI now, without standing first."""
        self.cause, self.phase = Cause.AHEAD, Phase.LEAVING

    def _count_late_in_a_row(self, telegram: Telegram) -> None:
        """Where the controller counts one more late answer than before, it did not take the last correction."""
        before, self._reported_late = self._reported_late, telegram.delay or 0
        self._late_in_a_row = self._late_in_a_row + 1 if self._reported_late > before else 0

    def _look_at_guards(self, now_ns: int, beats: Sequence[int]) -> None:
        """A guard's beat counts from the search's start at the earliest, whether it ever beat before or not."""
        for slot, oldest_ns in enumerate(self.order.guards_ns):
            age_ns = now_ns - max(beats[slot], self._began_ns or 0)
            if 0 < oldest_ns < age_ns:
                self.detail, self.age_ns = slot, age_ns
                self._end(Cause.GUARD)
                return

    def _end(self, cause: Cause) -> None:
        self.cause = cause
        if self.phase is Phase.MOVING:
            self.phase = Phase.BRAKING
        elif self.phase is Phase.LEARNING:
            self.phase = Phase.SETTLING

    def _move(self, gap: int) -> None:
        """One step; none while answers are late, so that the first one in time again is no leap."""
        if self.phase in (Phase.MOVING, Phase.BRAKING) and (gap > 1 or self._late_in_a_row > 1):
            self._stood()
        if self.phase is Phase.BRAKING:
            self._brake()
        elif self.phase is Phase.MOVING and gap and not self._late_in_a_row:
            self._advance()

    def _stood(self) -> None:
        """Telegrams or answers were lost: meanwhile the controller held a correction, and the set-point stood."""
        self._watch.stood()
        self._set_point.stand_and_go()

    def _advance(self) -> None:
        if self._set_point.arrived:
            self.phase = Phase.SETTLING
            self._end(Cause.TRAVEL)
            return
        self._set_point.advance()
        self._send_if_allowed(braking=False)

    def _brake(self) -> None:
        self._set_point.brake()
        self._send_if_allowed(braking=True)
        self._set_point.hold()
        self.phase = Phase.SETTLING

    def _send_if_allowed(self, *, braking: bool) -> None:
        correction = self._set_point.correction
        passed = self._watch.look(correction, braking=braking)
        if passed is Limit.NONE:
            self._sent = correction
            return
        self.cause, self.detail, self.phase = Cause.LIMIT, passed, Phase.SETTLING

    def _count_stop(self, stopped: bool, before: Correction) -> None:
        if not stopped or self._stood_by_stop or self.cause is not Cause.STOPPED:
            return
        self.stop_cycles += 1
        self._stood_by_stop = self._sent == before

    def _settle(self, joints: tuple[float, ...]) -> None:
        """Hold until the joints stand still, at most a while; then ask the controller to leave RSI."""
        if self.phase is not Phase.SETTLING:
            return
        self._held_cycles += 1
        self._recent.append(joints)
        cycle_s = (self.timing.cycle_ns or 4_000_000) * 1e-9
        held_s = self._held_cycles * cycle_s
        if held_s >= _LONGEST_HOLD_S or (held_s >= _SHORTEST_HOLD_S and self._stands()):
            self.phase = Phase.LEAVING

    def _stands(self) -> bool:
        spans = (max(axis) - min(axis) for axis in zip(*self._recent, strict=True))
        return len(self._recent) == _STANDING_CYCLES and max(spans) <= _STANDING_DEG
