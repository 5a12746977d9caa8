"""The interface of a task in an RSI session: input is an order, output the corrections in each cycle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol, final

from drivers.kuka_rsi.cyclic.cycle_timing import CycleTiming
from drivers.kuka_rsi.cyclic.limits import Correction
from drivers.kuka_rsi.cyclic.session import Admission
from drivers.kuka_rsi.cyclic.telegram import Telegram


class Phase(IntEnum):
    """Phase of a search."""

    IDLE = 0
    LEARNING = 1
    MOVING = 2
    BRAKING = 3
    SETTLING = 4
    LEAVING = 5
    OVER = 6


class Cause(IntEnum):
    """Why the set-point was stopped."""

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
    """An order to the cyclic process.

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
