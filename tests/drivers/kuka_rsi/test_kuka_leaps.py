"""Whatever happens on the line, no answer makes the controller's set-point leap: the whole responder, stateful.

A sequence is any order of delays, losses both ways, duplicates, overtaken and garbled telegrams, foreign senders, leaps
of the count, stalls of the driver, stops, and sessions switched on anew. Each of #ABSOLUTE and #RELATIVE with each of
#IPO_FAST and #IPO is a test of its own, and so is an address that states the other cycle: then nothing moves.
`LEAP_SEQUENCES` in the environment sets how many are tried.
"""

from __future__ import annotations

import math
import os
from typing import ClassVar

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule

from drivers.kuka_rsi.cyclic.limits import SearchLimits
from drivers.kuka_rsi.cyclic.search_cycle import SearchCycle
from drivers.kuka_rsi.cyclic.session import InterpolationCycle, SearchOrder
from drivers.kuka_rsi.cyclic.shared_block import Slot
from drivers.kuka_rsi.cyclic.telegram import CorrectionMode
from tests.helpers.krc import CALM, FAULTS, ROUNDING, TIMEOUT, FaultyLine, Krc, Weather

SEQUENCES = int(os.environ.get("LEAP_SEQUENCES", "100"))

LINE = (0.0, 3.0, -1.0, 0.0, 0.5, 0.0)
SPEED = 2.0
LIMITS = SearchLimits()
ENDS = ["stop", "stall", "half a cycle", "leap", "back", "by hand", "by hand, new port", "by hand, counted anew"]


class Line(FaultyLine):
    """The driver's responder and the controller, with everything that may go wrong between them.

    `cycle_of_krc` is the controller's, `stated` the one in the robot's address.
    """

    mode: ClassVar[CorrectionMode]
    cycle_of_krc: ClassVar[InterpolationCycle]
    stated: ClassVar[InterpolationCycle]

    @initialize(
        counts=st.sampled_from(["total", "reset", "none"]),
        precision=st.sampled_from([1, 4]),
    )
    def begin(self, counts: str, precision: int) -> None:
        relative = self.mode is CorrectionMode.RELATIVE
        krc = Krc(relative, self.cycle_of_krc.milliseconds, counts, precision, ipoc=10**12)
        self.connect(krc, lambda order: SearchCycle(order, LIMITS, self.mode, TIMEOUT, self.stated))
        self.next_session()
        assert any(self.krc.offset) == (self.stated is self.cycle_of_krc)

    def check(self, step_before: tuple[float, ...]) -> None:
        """Speed, correction and acceleration of what the controller holds from one cycle to the next."""
        dt = self.krc.cycle_ms / 1000
        assert self.stated is self.cycle_of_krc or not any(self.krc.offset)
        if self.krc.counts == "none" and not self.krc.relative:  # what may pile up, see `Following`
            blur = 0.02 + 2 * 10**-self.krc.precision
            for step, along in zip(self.step, LINE, strict=True):
                speed = SPEED * abs(along) / math.hypot(*LINE)
                assert abs(step) <= (speed * (0.15 + 4 * dt) + blur if along else 0.0)
        else:
            assert math.hypot(*self.step) <= SPEED * dt + ROUNDING
        assert max(map(abs, self.krc.offset)) <= LIMITS.correction_deg
        if self.calm > 3 and self.krc.counts != "none":
            bend = math.dist(self.step, step_before)
            allowed = SPEED * dt / 2 if self.block.status().cause else LIMITS.acceleration_deg_s2 * dt**2
            assert bend <= allowed + 2 * ROUNDING

    # what may happen

    @rule(faults=st.lists(st.sampled_from([Weather(), *FAULTS]), min_size=2, max_size=12), then=CALM)
    def many_faults(self, faults: list[Weather], then: int) -> None:
        for fault in faults:
            self.cycle(fault)
        self.spell(then, Weather())

    @rule(by=st.sampled_from([2, 9, 30]), then=CALM)
    def the_count_skips(self, by: int, then: int) -> None:
        """Without an answer missed: no session of one controller does that."""
        self.spell(2, Weather())
        self.krc.ipoc += by * self.krc.cycle_ms
        self.calm = 0
        self.spell(1, Weather())
        stands = self.krc.offset
        self.spell(then, Weather())
        assert self.krc.offset == stands
        self.next_session()

    @rule(what=st.sampled_from(ENDS), then=CALM)
    def an_end(self, what: str, then: int) -> None:
        """What the search does not go on after; and another search."""
        krc = self.krc
        match what:
            case "stop":
                self.block.words[Slot.STOP] = self.number
            case "stall":
                self.spell(TIMEOUT - 2, Weather(asleep=True))
                krc.unanswered = 0  # this controller tolerates more than the driver was told
                self.spell(177, Weather(asleep=True))
            case "half a cycle" | "leap" | "back":
                krc.ipoc += {"half a cycle": 1 - krc.cycle_ms, "leap": 100_000, "back": -100_000}[what]
                self.calm = 0
            case "by hand" | "by hand, new port" | "by hand, counted anew":
                self.switch_on(1300, new_port="port" in what)
                krc.ipoc //= 2 if "anew" in what else 1
        self.spell(1, Weather())
        stands = krc.offset
        self.spell(then + 20, Weather())
        assert what in ("stop", "half a cycle") or krc.offset == stands
        self.next_session()

    def next_session(self) -> None:
        """Ordered once the last one was ended; its session is announced after some telegrams."""
        self.end_session()
        self.block.place_order(SearchOrder(self.number, self.krc.joints, LINE, SPEED, (0,) * 8))
        self.spell(2, Weather())
        self.block.announce_session(self.number)
        self.spell(75, Weather())


def sequences(
    mode: CorrectionMode, cycle: InterpolationCycle, stated: InterpolationCycle, count: int
) -> type[RuleBasedStateMachine.TestCase]:
    machine = type("Line", (Line,), {"mode": mode, "cycle_of_krc": cycle, "stated": stated})
    machine.TestCase.settings = settings(
        max_examples=max(1, count), stateful_step_count=20, derandomize=True, deadline=None, print_blob=True
    )
    return machine.TestCase


ABSOLUTE, RELATIVE = CorrectionMode
FAST, SLOW = InterpolationCycle

TestNoLeapAbsoluteIpoFast = sequences(ABSOLUTE, FAST, FAST, SEQUENCES // 4)
TestNoLeapAbsoluteIpo = sequences(ABSOLUTE, SLOW, SLOW, SEQUENCES // 4)
TestNoLeapRelativeIpoFast = sequences(RELATIVE, FAST, FAST, SEQUENCES // 4)
TestNoLeapRelativeIpo = sequences(RELATIVE, SLOW, SLOW, SEQUENCES // 4)
TestNothingMovesAbsoluteIpoWhereIpoFastIsStated = sequences(ABSOLUTE, SLOW, FAST, SEQUENCES // 20)
TestNothingMovesAbsoluteIpoFastWhereIpoIsStated = sequences(ABSOLUTE, FAST, SLOW, SEQUENCES // 20)
TestNothingMovesRelativeIpoWhereIpoFastIsStated = sequences(RELATIVE, SLOW, FAST, SEQUENCES // 20)
TestNothingMovesRelativeIpoFastWhereIpoIsStated = sequences(RELATIVE, FAST, SLOW, SEQUENCES // 20)
