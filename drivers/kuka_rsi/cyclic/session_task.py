"""What every task of an RSI session has: its state, the admission of telegrams and the guards."""

from __future__ import annotations

from collections.abc import Sequence

from drivers.kuka_rsi.axes import AXES
from drivers.kuka_rsi.cyclic.cycle_timing import CycleTiming, InterpolationCycle
from drivers.kuka_rsi.cyclic.limits import Correction
from drivers.kuka_rsi.cyclic.session import Admission, Session
from drivers.kuka_rsi.cyclic.task import Cause, Phase, SearchOrder
from drivers.kuka_rsi.cyclic.telegram import Telegram


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

        The age counts from the task's start at the earliest, even without an earlier beat.
        """
        for slot, oldest_ns in enumerate(self.order.guards_ns):
            age_ns = now_ns - max(beats[slot], self._began_ns or 0)
            if 0 < oldest_ns < age_ns:
                self.detail, self.age_ns = slot, age_ns
                return True
        return False
