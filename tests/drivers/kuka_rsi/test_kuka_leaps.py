"""Whatever happens on the line, no answer makes the controller's set-point leap: the whole responder, stateful.

The controller here holds set-points as RSI does, and is written apart from the driver and from the simulator. A
sequence is any order of delays, losses both ways, duplicates, overtaken and garbled telegrams, foreign senders, leaps
of the count, stalls of the driver, stops, and sessions switched on anew. Each of #ABSOLUTE and #RELATIVE with each of
#IPO_FAST and #IPO is a test of its own, and so is an address that states the other cycle: then nothing moves.
`LEAP_SEQUENCES` in the environment sets how many are tried.
"""

from __future__ import annotations

import math
import os
import re
from collections import deque
from dataclasses import dataclass, field
from typing import ClassVar

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule

from drivers.kuka_rsi.cyclic.controller_line import ControllerLine
from drivers.kuka_rsi.cyclic.correction_mode import CorrectionMode
from drivers.kuka_rsi.cyclic.cycle_timing import InterpolationCycle
from drivers.kuka_rsi.cyclic.limits import SearchLimits
from drivers.kuka_rsi.cyclic.responder import Responder
from drivers.kuka_rsi.cyclic.search_cycle import SearchCycle
from drivers.kuka_rsi.cyclic.shared_block import SharedBlock, Slot
from drivers.kuka_rsi.cyclic.task import SearchOrder
from drivers.kuka_rsi.cyclic.telegram import ReplyFormat

SEQUENCES = int(os.environ.get("LEAP_SEQUENCES", "100"))

HOME = (0.0, -90.0, 90.0, 0.0, 45.0, 0.0)
LINE = (0.0, 3.0, -1.0, 0.0, 0.5, 0.0)
SPEED = 2.0
LIMITS = SearchLimits()
TIMEOUT = 100
CONTROLLER = "192.168.10.1"
ROUNDING = 3e-6
SERVO_S = 0.024
TEMPLATE = '<Sen><AK A="{0:.6f} {1:.6f} {2:.6f} {3:.6f} {4:.6f} {5:.6f}"/><Stop>{6:d}</Stop><IPOC>{7}</IPOC></Sen>'


@dataclass(frozen=True)
class Weather:
    """What happens to one cycle's telegram and answer; delays, and what the count is off by, in cycles."""

    telegram_lost: bool = False
    telegram_late: int = 0
    twice: bool = False
    answer_lost: bool = False
    answer_late: int = 0
    foreign: bool = False
    asleep: bool = False
    count_off: int = 0


FAULTS = [
    Weather(telegram_lost=True),
    Weather(telegram_late=1),
    Weather(telegram_late=3),
    Weather(twice=True),
    Weather(answer_lost=True),
    Weather(answer_late=1),
    Weather(telegram_late=1, twice=True, answer_late=1),
    Weather(foreign=True),
    Weather(asleep=True),
    *(Weather(count_off=by) for by in (-25_000, -1, 1, 8)),
]
CALM = st.sampled_from([0, 1, 2, 5, 60])
ENDS = ["stop", "stall", "half a cycle", "leap", "back", "by hand", "by hand, new port", "by hand, counted anew"]


@dataclass
class Krc:
    """RSI from RSI_ON on: what it sends, what it holds. `counts`: how its Delay behaves, `total`, `reset` or `none`."""

    relative: bool
    cycle_ms: int
    counts: str
    precision: int
    ipoc: int
    port: int = 30_000
    late: int = 0
    unanswered: int = 0
    on: bool = True
    outputs: tuple[float, ...] = (0.0,) * 6
    offset: tuple[float, ...] = (0.0,) * 6
    joints: tuple[float, ...] = HOME
    zero: tuple[float, ...] = HOME
    answer: tuple[float, ...] | None = None

    def hear(self, reply: bytes) -> None:
        ipoc = int(re.search(rb"<IPOC>(\d+)<", reply)[1])
        if self.on and ipoc == self.ipoc:
            self.answer = tuple(map(float, re.search(rb'A="([^"]*)"', reply)[1].split()))

    def cycle(self) -> bool:
        """Take the answer that came, or do without, and go on by a cycle. Whether one was taken."""
        taken = self.answer is not None
        if taken:
            self.outputs, self.unanswered = self.answer, 0
            self.late = 0 if self.counts == "reset" else self.late
        else:
            self.late, self.unanswered = self.late + 1, self.unanswered + 1
            self.outputs = (0.0,) * 6 if self.relative else self.outputs
        self.offset = plus(self.offset, self.outputs) if self.relative else self.outputs
        share = 1 - math.exp(-self.cycle_ms / 1000 / SERVO_S)
        target = plus(self.zero, self.offset)
        self.joints = tuple(a + share * (b - a) for a, b in zip(self.joints, target, strict=True))
        self.answer = None
        self.ipoc += self.cycle_ms
        self.on = self.unanswered <= TIMEOUT
        return taken

    def telegram(self, ipoc: int | None = None) -> bytes:
        axes = " ".join(f'A{i}="{value:.{self.precision}f}"' for i, value in enumerate(self.joints, 1))
        delay = "" if self.counts == "none" else f'<Delay D="{self.late}"/>'
        return f"<Rob><AIPos {axes}/>{delay}<IPOC>{ipoc or self.ipoc}</IPOC></Rob>".encode()

    def switch_on(self) -> None:
        """A new session: its output begins at zero, its zero is where the robot is."""
        self.on, self.late, self.unanswered, self.answer = True, 0, 0, None
        self.outputs = self.offset = (0.0,) * 6
        self.zero = self.joints


def plus(a: tuple[float, ...], b: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(x + y for x, y in zip(a, b, strict=True))


@dataclass
class Wire:
    """Stands in for the socket: datagrams under way in both directions, with the cycle in which they arrive."""

    inbox: deque[tuple[bytes, tuple[str, int]]] = field(default_factory=deque)
    replies: list[bytes] = field(default_factory=list)

    def recvfrom(self, size: int) -> tuple[bytes, tuple[str, int]]:
        if not self.inbox:
            raise BlockingIOError
        return self.inbox.popleft()

    def sendto(self, reply: bytes, place: tuple[str, int]) -> None:
        assert place[0] == CONTROLLER
        self.replies.append(reply)

    def setsockopt(self, *_: object) -> None:
        raise OSError("no filter here")


class Line(RuleBasedStateMachine):
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
        self.krc = Krc(relative, self.cycle_of_krc.milliseconds, counts, precision, ipoc=10**12)
        self.wire = Wire()
        self.block, fd = SharedBlock.create()
        os.close(fd)
        line = ControllerLine(self.wire, CONTROLLER)

        def task_of(order: SearchOrder) -> SearchCycle:
            return SearchCycle(order, LIMITS, self.mode, TIMEOUT, self.stated)

        self.now_ns = 0
        self.responder = Responder(line, self.block, ReplyFormat(TEMPLATE), lambda: self.now_ns, task_of)
        self.number = 0
        self.under_way: list[tuple[int, bytes, tuple[str, int]]] = []
        self.answers_under_way: list[tuple[int, bytes]] = []
        self.time = 0
        self.next_search()
        assert any(self.krc.offset) == (self.stated is self.cycle_of_krc)

    # what is checked

    def cycle(self, weather: Weather) -> None:
        before, step_before, krc = self.krc.offset, self.step, self.krc
        self.time += 1
        self.now_ns += krc.cycle_ms * 1_000_000
        self.calm = self.calm + 1 if krc.cycle() else 0
        self.step = tuple(a - b for a, b in zip(krc.offset, before, strict=True))
        self.check(step_before)
        if krc.on:
            self.send(krc.telegram(krc.ipoc + weather.count_off * krc.cycle_ms), weather)
        if weather.foreign:
            for place in (("10.0.0.9", 30_000), (CONTROLLER, 9)):
                self.wire.inbox.append((krc.telegram(krc.ipoc + 400), place))
        self.carry(weather)

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

    # the line

    def send(self, telegram: bytes, weather: Weather) -> None:
        place = (CONTROLLER, self.krc.port)
        for _ in range(0 if weather.telegram_lost else 1 + weather.twice):
            self.under_way.append((self.time + weather.telegram_late, telegram, place))

    def carry(self, weather: Weather) -> None:
        due = [one for one in self.under_way if one[0] <= self.time]
        self.under_way = [one for one in self.under_way if one[0] > self.time]
        self.wire.inbox.extend((telegram, place) for _, telegram, place in due)
        if not weather.asleep:
            self.responder.answer()
        if not weather.answer_lost:
            self.answers_under_way += [(self.time + weather.answer_late, reply) for reply in self.wire.replies]
        self.wire.replies.clear()
        for one in [one for one in self.answers_under_way if one[0] <= self.time]:
            self.answers_under_way.remove(one)
            self.krc.hear(one[1])

    # what may happen

    @rule(fault=st.sampled_from(FAULTS), cycles=st.sampled_from([1, 1, 1, 2, 5]), then=CALM)
    def one_fault(self, fault: Weather, cycles: int, then: int) -> None:
        self.spell(cycles, fault)
        self.spell(then, Weather())

    @rule(faults=st.lists(st.sampled_from([Weather(), *FAULTS]), min_size=2, max_size=12), then=CALM)
    def many_faults(self, faults: list[Weather], then: int) -> None:
        for fault in faults:
            self.cycle(fault)
        self.spell(then, Weather())

    @rule(cycles=st.sampled_from([30, 60, 90]), asleep=st.booleans(), then=CALM)
    def an_outage(self, cycles: int, asleep: bool, then: int) -> None:
        """Within the tolerance, if it is not the second in a row."""
        self.spell(cycles, Weather(asleep=True) if asleep else Weather(answer_lost=True))
        self.spell(then, Weather())

    @rule(by=st.sampled_from([2, 9, 30]), then=CALM)
    def the_count_skips(self, by: int, then: int) -> None:
        self.krc.ipoc += by * self.krc.cycle_ms
        self.calm = 0
        self.spell(then, Weather())

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
        self.next_search()

    def next_search(self) -> None:
        """Ordered once the last one was ended; its session is announced after some telegrams."""
        self.block.release()
        self.responder.answer()
        self.switch_on(500, new_port=False)
        self.number += 1
        self.block.words[Slot.STOP] = 0
        self.block.place_order(SearchOrder(self.number, self.krc.joints, LINE, SPEED, (0,) * 8))
        self.spell(2, Weather())
        self.block.announce_session(self.number)
        self.spell(75, Weather())

    def spell(self, cycles: int, weather: Weather) -> None:
        for _ in range(cycles):
            self.cycle(weather)

    def switch_on(self, after_ms: int, new_port: bool) -> None:
        self.time += after_ms // self.krc.cycle_ms
        self.now_ns += after_ms * 1_000_000
        self.krc.ipoc += after_ms
        self.krc.port += new_port
        self.krc.switch_on()
        self.step, self.calm = (0.0,) * 6, 0


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
