"""On-line correction: while the controller runs its own program, each telegram is answered with a model's correction.

Pure apart from the shared memory: telegrams, time and slots in, corrections out. The correction begins at zero and ends
at zero; between, it follows the model as fast as its limits allow, from standstill after each answer that the
controller may not have taken. Nothing else changes it: a new model, the end of the measured region and the ramp out are
changes of what is wanted.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, final

from drivers.kuka_rsi import AXES
from drivers.kuka_rsi.cyclic.following import NotFollowed
from drivers.kuka_rsi.cyclic.limits import Correction, CorrectionMotion, Limit, OnlineLimits, within
from drivers.kuka_rsi.cyclic.online_block import LogRow, OnlineBlock, OnlineSlot
from drivers.kuka_rsi.cyclic.real_time import beside_other_processes
from drivers.kuka_rsi.cyclic.session import (
    DEFAULT_TOLERANCE,
    Cause,
    InterpolationCycle,
    Phase,
    SearchOrder,
    SessionTask,
)
from drivers.kuka_rsi.cyclic.telegram import DECIMALS, Telegram

if TYPE_CHECKING:
    from drivers.kuka_rsi.cyclic.online_model import OnlineModel  # numpy and numba: 1 s

LOG_EVERY_NS = 1_000_000_000
"""Of the log that the engine puts into the journal: once a second of the cell's time."""

_ZERO: Correction = (0.0,) * AXES


@final
class OnlineCorrection(SessionTask):
    """The correction of one RSI session: a CyclicTask. Phases: LEARNING, MOVING (it corrects), BRAKING (it fades to
    zero), SETTLING (it is held), LEAVING (it is zero and stays so), OVER.

    A stop holds the correction as it is. Every other cause lets it fade to zero: the end on request, the engine's
    silence, the end of the process, a telegram without ASPos or Delay, axes that do not follow. If the learnt cycle is
    not `cycle`, it never leaves zero; `detail` is the learnt cycle then, ns.
    """

    def __init__(
        self,
        order: SearchOrder,
        limits: OnlineLimits,
        online: OnlineBlock,
        tolerance_cycles: int = DEFAULT_TOLERANCE,
        cycle: InterpolationCycle = InterpolationCycle.IPO_FAST,
    ) -> None:
        super().__init__(order, tolerance_cycles, cycle)
        self._limits = limits
        self._online = online
        self._tolerance = tolerance_cycles
        self._not_taken = 0
        self._log_due_ns = 0
        self._version = -1
        self._model: OnlineModel | None = None
        with beside_other_processes():  # RSI is still off: no telegram is read in these seconds
            self._take_newest_model()
            if self._model and not self._model.is_within(limits.online_correction_deg):
                self._model = None  # cut to the limit it would be no correction
                self._fade(Cause.OVER_LIMIT)

    def answer(
        self, telegram: Telegram, now_ns: int, stopped: bool, beats: Sequence[int], *, leave: bool = False
    ) -> tuple[Correction, bool]:
        """The offsets to answer an admitted `telegram` with, and no stop: there is no sensor motion to leave."""
        taken = self._take_in(telegram, now_ns)
        self._look_for_trouble(telegram, now_ns, stopped, beats, leave)
        if self.timing.learnt:
            self._move(telegram, taken, now_ns)
        return self._sent, False

    def _take_in(self, telegram: Telegram, now_ns: int) -> bool:
        """Whether the last answer was taken; estimates the cycle first."""
        if self._began_ns is None:
            self._began_ns = now_ns
        learnt = self.timing.learnt
        gap, taken = self._session.answering(telegram, now_ns)
        if self.timing.learnt and not learnt:
            cycle_s = self.timing.cycle_ns * 1e-9
            self._motion = CorrectionMotion(self._limits, cycle_s)
            self._not_followed = NotFollowed(cycle_s)
            self._asked_deg = self._limits.asked_deg(cycle_s)
            if self.phase is Phase.LEARNING:
                self._check_cycle()
        self.missed += gap - 1
        return taken

    def _check_cycle(self) -> None:
        """In another cycle the limits per second would not hold: the correction stays zero."""
        if self._cycle.fits(self.timing.cycle_ns):
            self.phase = Phase.MOVING
        else:
            self.detail = self.timing.cycle_ns
            self._fade(Cause.CYCLE)

    def _look_for_trouble(
        self, telegram: Telegram, now_ns: int, stopped: bool, beats: Sequence[int], leave: bool
    ) -> None:
        if stopped and self.cause is not Cause.STOPPED:  # also in a fade: a stop holds, and no longer leads to zero
            self.cause, self.phase = Cause.STOPPED, Phase.SETTLING
        if self.cause is not Cause.NONE:
            return
        if leave:
            self._fade(Cause.LEFT)
        elif self._online.words[OnlineSlot.RAMP_OUT] == self.number:
            self._fade(Cause.TRAVEL)
        elif telegram.programmed is None or telegram.delay is None:
            self._fade(Cause.UNKNOWN)
        elif self._model is None:
            self._fade(Cause.MODEL)
        elif self._guard_is_silent(now_ns, beats):
            self._fade(Cause.GUARD)

    def _fade(self, cause: Cause) -> None:
        self.cause, self.phase = cause, Phase.BRAKING

    def _move(self, telegram: Telegram, taken: bool, now_ns: int) -> None:
        """One step; none until the last answer is known to be taken: the controller holds one of two corrections."""
        self._not_taken = 0 if taken else self._not_taken + 1
        if not taken:
            self._motion.stood()
            if self._not_taken > self._tolerance and self.cause is Cause.NONE:
                self._fade(Cause.NOT_TAKEN)
            return
        if self.phase is Phase.MOVING and self._not_followed.look(telegram, self._sent):
            self._fade(Cause.BEHIND)
        programmed = telegram.programmed or _ZERO
        wanted, inside, limited = self._wanted(programmed)
        passed = self._motion.follow(wanted)
        if passed is not Limit.NONE and self.cause is Cause.NONE:
            self.detail = passed
            self._fade(Cause.LIMIT)
        self._sent = tuple(round(axis, DECIMALS) + 0.0 for axis in self._motion.sent)  # + 0.0: no minus before a zero
        if self.phase is Phase.BRAKING and not any(self._sent) and self._motion.stands:
            self.phase = Phase.LEAVING
        self._online.publish(self._sent, programmed, inside)
        if self.phase is Phase.MOVING:
            self._online.count(inside, limited or self._motion.limited)
        if now_ns >= self._log_due_ns:
            self._log_due_ns = now_ns + LOG_EVERY_NS
            self._online.add_log_row(LogRow(now_ns, programmed, self._sent, inside))

    def _wanted(self, programmed: tuple[float, ...]) -> tuple[Sequence[float], float, bool]:
        """The wanted correction, deg; the share by which it is faded, and whether the limit cut it."""
        if self.phase is Phase.SETTLING:
            return self._motion.sent, 0.0, False
        if self.phase is not Phase.MOVING or self._model is None:
            return _ZERO, 0.0, False
        self._take_newest_model()
        inside = self._model.inside(programmed)
        if not inside:
            return _ZERO, 0.0, False
        began = time.perf_counter_ns()  # the computer's own work: wall time, whatever the cell's clock is
        wanted = self._model.correction(programmed)
        self._online.lasted(time.perf_counter_ns() - began)
        bounded, limited = within([inside * axis for axis in wanted], self._asked_deg)
        return bounded, inside, limited

    def _take_newest_model(self) -> None:
        """One that is not complete or not valid is refused, and the last one stays.

        The first one imports the compiled step (1 s; 10 s the very first time): a search needs none.
        """
        version = self._online.words[OnlineSlot.VERSION]
        if version == self._version or not version:
            return
        self._version = version
        from drivers.kuka_rsi.cyclic.online_model import OnlineModel  # numpy and numba: 1 s

        try:
            last = self._model.last_rad if self._model else None
            self._model = OnlineModel(self._online.read_model(version), last)
        except ValueError:
            self._online.words[OnlineSlot.REFUSED] = version
        else:
            self._online.words[OnlineSlot.TAKEN] = version
