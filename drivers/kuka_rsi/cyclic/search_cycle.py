"""One search, cycle by cycle: a jerk-limited set-point along a joint-space line, and the answer to each telegram.

The line is c(s) = s/L · c_end, 0 ≤ s ≤ L = ‖c_end‖, so that all axes start and stop together. s(t) is the time-optimal
profile with bounded speed, acceleration and jerk (Ruckig; Berscheid and Kröger 2021), sampled each cycle. The TCP goes
along an arc near the straight line: a search is some degrees long, and the contact is found by the joints, not by s.

A stop ends it in two telegrams: with the last step d = v T the next one is d/2, the mean of a constant deceleration
from v to 0 within one cycle, and then none. That is an acceleration of v/2T, which `CycleWatch` allows while braking.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import final

from ruckig import InputParameter, Result, Ruckig, Trajectory

from drivers.kuka_rsi.cyclic.following import LONGEST_LAG_S, Following, Follows
from drivers.kuka_rsi.cyclic.limits import Correction, CycleWatch, Limit, SearchLimits
from drivers.kuka_rsi.cyclic.session import (
    DEFAULT_TOLERANCE,
    Admission,
    Cause,
    InterpolationCycle,
    Phase,
    SearchOrder,
    SessionTask,
)
from drivers.kuka_rsi.cyclic.telegram import CorrectionMode, Telegram, WrittenCorrections


@final
class SetPoint:
    """A point on the line from the pose at RSI_ON (0) to `correction`, one step a cycle; every axis in proportion.

    `correction`: offset of A1…A6 at the line's end, degrees; `speed_deg_s`: of the Euclidean norm.
    """

    def __init__(self, correction: Correction, speed_deg_s: float, limits: SearchLimits, cycle_s: float) -> None:
        self._end = correction
        self._length = math.hypot(*correction)
        self._speed = speed_deg_s
        self._limits = limits
        self._cycle_s = cycle_s
        self._here = self._before = 0.0
        self._otg = Ruckig(1)
        self.stand_and_go()

    @property
    def correction(self) -> Correction:
        """Offset of A1…A6 from the pose at RSI_ON, degrees."""
        share = self._here / self._length if self._length else 0.0
        return tuple(share * axis for axis in self._end)

    @property
    def place_deg(self) -> float:
        """Distance travelled on the line, degrees."""
        return self._here

    @property
    def arrived(self) -> bool:
        """Whether the end of the line is reached."""
        return bool(self._elapsed >= self._profile.duration)

    def stand_and_go(self) -> None:
        """Plan from standstill here: at the start, and after the controller held the last correction for a while."""
        plan = InputParameter(1)
        plan.current_position, plan.target_position = [self._here], [self._length]
        plan.max_velocity = [self._speed]
        plan.max_acceleration = [self._limits.acceleration_deg_s2]
        plan.max_jerk = [self._limits.jerk_deg_s3]
        self._profile = Trajectory(1)
        result = self._otg.calculate(plan, self._profile)
        if result not in (Result.Working, Result.Finished):
            raise ValueError(f"no profile of {self._length} deg at {self._speed} deg/s: {result}")
        self._elapsed = 0.0
        self._before = self._here

    def advance(self) -> None:
        """One cycle further along the profile."""
        self._elapsed += self._cycle_s
        self._move_to(self._profile.at_time(min(self._elapsed, self._profile.duration))[0][0])

    def brake(self) -> None:
        """Half of the last step, from constant deceleration to a stop within one cycle; then `hold`.

        Not beyond the line's end, where the last step may be shorter than the one before.
        """
        self._move_to(min(self._here + (self._here - self._before) / 2, self._length))

    def hold(self) -> None:
        """Stay."""
        self._before = self._here

    def _move_to(self, place: float) -> None:
        self._before, self._here = self._here, place


_STANDING_DEG = 0.001
"""Joints within this span, deg, over `_STANDING_CYCLES` are at standstill: ten of the last decimals at Precision 4,
twice a common encoder's step.

At Precision 1 a joint between two tenths of a degree may flicker: it never stands, and `_LONGEST_HOLD_S` ends the hold.
"""

_STANDING_CYCLES = 10
"""40 ms at 4 ms, 120 ms at 12 ms."""

_SHORTEST_HOLD_S = 0.06
_LONGEST_HOLD_S = 1.0
"""The last set-point is held until the joints stand, at least and at most so long. At least: about the servo's lag
(24 ms) and `_STANDING_CYCLES` at 4 ms, so that joints that have not begun to move are not taken for standing.

After the longest time RSI is left all the same, as without a bound a joint that trembles would keep it on.
"""

_START_TOLERANCE_DEG = 0.1
"""Largest difference of the pose at RSI_ON from the planned start.

Not less than the coarsest step of a telegram (Precision 1). The planned start is the last pose that EthernetKRL
reported: a robot that was moved since would search beside its line.
"""


@final
class SearchCycle(SessionTask):
    """One search, in one RSI session: a CyclicTask.

    No answer differs by more than the limits from any set-point that the controller may hold: either the last one
    known to be taken or the last one sent. The next one is sent only when the last is known to
    be taken. Until then the last one is repeated, and the path is planned again from standstill. Two allowances: the
    repeated set-point, when finally taken, is one step (speed × cycle) from standstill, as a lost answer is one
    to a standstill; and braking on a stop, see `CycleWatch`. Without Delay, see `Following` for the possible lead.

    `detail` is the guard slot, which limit, the rise of the count, or the learnt cycle in ns, by `cause`; `age_ns` is
    the guard's. If the learnt cycle is not `cycle`, RSI is left before any motion.
    """

    def __init__(
        self,
        order: SearchOrder,
        limits: SearchLimits,
        mode: CorrectionMode = CorrectionMode.ABSOLUTE,
        tolerance_cycles: int = DEFAULT_TOLERANCE,
        cycle: InterpolationCycle = InterpolationCycle.IPO_FAST,
    ) -> None:
        super().__init__(order, tolerance_cycles, cycle)
        self._limits = limits
        self._start = order.start
        self._written = WrittenCorrections(mode)
        self._held_cycles = 0
        self._stood_by_stop = False
        self._programmed: tuple[float, ...] | None = None
        self._recent: deque[tuple[float, ...]] = deque(maxlen=_STANDING_CYCLES)

    def admit(self, telegram: Telegram) -> Admission:
        """As every task; and a search moves no program: programmed joints that change are those of another session."""
        if telegram.programmed and not self._session.over:
            moved = zip(telegram.programmed, self._programmed or telegram.programmed, strict=True)
            if max(abs(a - b) for a, b in moved) > telegram.resolution_deg:
                self._session.end(telegram)
            self._programmed = self._programmed or telegram.programmed
        return super().admit(telegram)

    def answer(
        self, telegram: Telegram, now_ns: int, stopped: bool, beats: Sequence[int], *, leave: bool = False
    ) -> tuple[Correction, bool]:
        """The corrections and the stop to answer an admitted `telegram` with; see CyclicTask."""
        taken = self._take_in(telegram, now_ns)
        self._look_for_trouble(now_ns, stopped, beats, leave)
        self._look_whether_it_follows(telegram)
        before = self._sent
        self._move(taken)
        self._count_stop(stopped, before)
        self._settle(telegram.joints)
        self._keep(telegram)
        return self._written.leading_to(self._sent), self.phase is Phase.LEAVING

    def _take_in(self, telegram: Telegram, now_ns: int) -> bool:
        """Whether the last answer was taken; estimates the cycle first."""
        if self._began_ns is None:
            self._began_ns = now_ns
            self._check_start(telegram.joints)
        learnt = self.timing.learnt
        gap, taken = self._session.answering(telegram, now_ns)
        if self.timing.learnt and not learnt:
            self._get_ready()
        if self.phase is not Phase.LEAVING:
            self.missed += gap - 1
        if not taken:
            self._written.not_taken()
        return taken

    def _check_start(self, joints: tuple[float, ...]) -> None:
        """Otherwise the session ends before any motion; zero is correct then, as there was no correction yet."""
        self._start = joints
        if max(abs(a - b) for a, b in zip(joints, self.order.start, strict=True)) > _START_TOLERANCE_DEG:
            self.cause, self.phase = Cause.START, Phase.LEAVING

    def _get_ready(self) -> None:
        cycle_s = self.timing.cycle_ns * 1e-9
        speed = self.order.speed_deg_s
        self._watch = CycleWatch(self._limits, cycle_s)
        self._set_point = SetPoint(self.order.correction, speed, self._limits, cycle_s)
        lag = math.ceil(LONGEST_LAG_S / cycle_s) * self.timing.ipoc_step
        self._following = Following(self._start, self.order.correction, speed * cycle_s, lag)
        if self.phase is Phase.LEARNING:
            self._check_cycle()

    def _check_cycle(self) -> None:
        """As in `_check_start`: zero is correct, as there was no correction yet."""
        if self._cycle.fits(self.timing.cycle_ns):
            self.phase = Phase.MOVING
        else:
            self.cause, self.detail, self.phase = Cause.CYCLE, self.timing.cycle_ns, Phase.LEAVING

    def _look_for_trouble(self, now_ns: int, stopped: bool, beats: Sequence[int], leave: bool) -> None:
        # The stop first: a contact counts although the probe has just died. It also counts while the end of the line is
        # held: the robot still lags behind the last set-point.
        if stopped and self.cause in (Cause.NONE, Cause.TRAVEL):
            self._end(Cause.STOPPED)
        if self.cause is Cause.NONE and leave:
            self._end(Cause.LEFT)
        if self.cause is Cause.NONE and self._guard_is_silent(now_ns, beats):
            self._end(Cause.GUARD)

    def _look_whether_it_follows(self, telegram: Telegram) -> None:
        """Ahead: the controller sums up offsets, and holding would keep moving; leave RSI without standstill."""
        if not self.timing.learnt or self.phase is Phase.LEAVING:
            return
        follows = self._following.look(telegram, self._written.short_deg)
        if follows is Follows.AHEAD:
            self.cause, self.phase = Cause.AHEAD, Phase.LEAVING
        elif follows is Follows.BEHIND and self.cause is Cause.NONE:
            self._end(Cause.BEHIND)

    def _end(self, cause: Cause) -> None:
        self.cause = cause
        if self.phase is Phase.MOVING:
            self.phase = Phase.BRAKING
        elif self.phase is Phase.LEARNING:
            self.phase = Phase.SETTLING

    def _move(self, taken: bool) -> None:
        """One step; none until the last answer is known to be taken: the controller holds one of two set-points."""
        if self.phase not in (Phase.MOVING, Phase.BRAKING):
            return
        if not taken:
            self._watch.stood()
            self._set_point.stand_and_go()
        if self.phase is Phase.BRAKING:
            self._brake()
        elif taken:
            self._advance()

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

    def _keep(self, telegram: Telegram) -> None:
        if self.timing.learnt:
            self._following.sent(telegram.ipoc, self._set_point.place_deg)

    def _settle(self, joints: tuple[float, ...]) -> None:
        """Hold until the joints are at standstill, for a limited time; then tell the controller to leave RSI."""
        if self.phase is not Phase.SETTLING:
            return
        self._held_cycles += 1
        self._recent.append(joints)
        if self.cause is Cause.TRAVEL and self._held_cycles < self.order.hold_cycles:
            return
        # a stop may come before the cycle is learnt: then the address's cycle
        cycle_s = self.timing.cycle_ns * 1e-9 or self._cycle.milliseconds * 1e-3
        held_s = self._held_cycles * cycle_s
        if held_s >= _LONGEST_HOLD_S or (held_s >= _SHORTEST_HOLD_S and self._stands()):
            self.phase = Phase.LEAVING

    def _stands(self) -> bool:
        spans = (max(axis) - min(axis) for axis in zip(*self._recent, strict=True))
        return len(self._recent) == _STANDING_CYCLES and max(spans) <= _STANDING_DEG
