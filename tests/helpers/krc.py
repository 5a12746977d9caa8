"""An RSI line with everything that may go wrong on it: a controller that holds set-points as RSI does, the driver's
responder, and between them delays, losses both ways, duplicates, foreign senders and counts that are off.

The controller is written apart from the driver and from the simulator.
"""

from __future__ import annotations

import math
import os
import re
from abc import abstractmethod
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, rule

from drivers.kuka_rsi.cyclic.responder import ControllerLine, Responder
from drivers.kuka_rsi.cyclic.session import CyclicTask, SearchOrder
from drivers.kuka_rsi.cyclic.shared_block import SharedBlock, Slot
from drivers.kuka_rsi.cyclic.telegram import ReplyFormat

HOME = (0.0, -90.0, 90.0, 0.0, 45.0, 0.0)
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
RESTARTS = st.sampled_from([3, 4, 5, 9, 40, 98, 101, 1000])
"""Cycles from a session's last answer to the first telegram of the next one: after three or more it shows."""


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


class FaultyLine(RuleBasedStateMachine):
    """The driver's responder and the controller, cycle by cycle; `check` looks at each cycle."""

    def connect(self, krc: Krc, task_of: Callable[[SearchOrder], CyclicTask]) -> None:
        """The responder answers `krc` by the task of each order."""
        self.krc, self.wire = krc, Wire()
        self.block, fd = SharedBlock.create()
        os.close(fd)
        self.now_ns = self.time = self.number = 0
        line = ControllerLine(self.wire, CONTROLLER)
        self.responder = Responder(line, self.block, ReplyFormat(TEMPLATE), lambda: self.now_ns, task_of)
        self.under_way: list[tuple[int, bytes, tuple[str, int]]] = []
        self.answers_under_way: list[tuple[int, bytes]] = []

    @abstractmethod
    def check(self, step_before: tuple[float, ...]) -> None:
        """What the controller holds, `self.krc.offset`, went on by `self.step` in this cycle; asserts its limits."""

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

    def spell(self, cycles: int, weather: Weather) -> None:
        for _ in range(cycles):
            self.cycle(weather)

    def end_session(self) -> None:
        """The last order is over; RSI is switched on anew for the next number."""
        self.block.release()
        self.responder.answer()
        self.switch_on(500)
        self.number += 1
        self.block.words[Slot.STOP] = 0

    def switch_on(self, after_ms: int, *, new_port: bool = False) -> None:
        self.time += after_ms // self.krc.cycle_ms
        self.now_ns += after_ms * 1_000_000
        self.krc.ipoc += after_ms
        self.krc.port += new_port
        self.krc.switch_on()
        self.step, self.calm = (0.0,) * 6, 0

    @abstractmethod
    def next_session(self) -> None:
        """RSI is switched on anew, and the next order answers it."""

    @rule(after=RESTARTS, asleep=st.sampled_from([0, 1, 40]), then=CALM)
    def rsi_restarts(self, after: int, asleep: int, then: int) -> None:
        """By the same port, the count goes on; the PC sleeps before and after. Nobody announces it to the driver.

        The last answer was taken: a lost one, or a count that is off, would make it the restart after a cycle or two
        that no telegram shows.
        """
        self.spell(2, Weather())
        self.spell(min(asleep, after - 1), Weather(asleep=True))
        self.switch_on(max(1, after - asleep) * self.krc.cycle_ms)
        self.spell(asleep, Weather(asleep=True))
        self.spell(then + 5, Weather())
        assert not any(self.krc.offset)
        self.next_session()

    @rule(fault=st.sampled_from(FAULTS), cycles=st.sampled_from([1, 1, 1, 2, 5]), then=CALM)
    def one_fault(self, fault: Weather, cycles: int, then: int) -> None:
        self.spell(cycles, fault)
        self.spell(then, Weather())

    @rule(cycles=st.sampled_from([30, 60, 90]), asleep=st.booleans(), then=CALM)
    def an_outage(self, cycles: int, asleep: bool, then: int) -> None:
        """Within the tolerance, if it is not the second in a row."""
        self.spell(cycles, Weather(asleep=True) if asleep else Weather(answer_lost=True))
        self.spell(then, Weather())
