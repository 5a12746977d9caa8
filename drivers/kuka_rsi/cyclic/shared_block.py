"""Memory shared by the engine and the cyclic process: slots of eight bytes, each written by one side only.

An aligned slot is read and written atomically. Data that belong together are written first, the slot that announces
them (`ORDER`, `SESSION`, `SEARCH`, `HEAD`) last. The memory has no name: it is freed when both processes end.
"""

from __future__ import annotations

import mmap
import os
from contextlib import suppress
from dataclasses import dataclass
from enum import IntEnum
from ipaddress import IPv4Address
from math import isnan, nan
from typing import Self, final

from drivers.kuka_rsi import AXES
from drivers.kuka_rsi.cyclic.online_block import ONLINE_SLOTS, OnlineBlock
from drivers.kuka_rsi.cyclic.session import Cause, CyclicTask, Phase, SearchOrder

GUARDS = 8
"""Guard slots; slot 0 is the engine's own heartbeat. A cell has few devices that guard a search: a probe, a door."""

ROWS = 8192
"""Samples in the ring: 32 s at 4 ms. The engine reads it every 0.1 s, and may hang for less than a guard allows (0.25
s)."""

_ROW_SLOTS = 3 + 2 * AXES


class Slot(IntEnum):
    """Places of the slots. Up to `HOLD` the engine writes, from `SEARCH` on the cyclic process.

    `STOP`: not 0 stops every search until it is cleared. `SESSION`: number of the search for which the
    controller has reported that RSI is on. `FOREIGN_FROM`: last foreign sender, see `foreign_sender`. `SENDER_PORT`,
    `MARK`, `FIRST_DELAY`: of the first telegram that was answered; `DELAY`: of the last one, -1 if it sends none.
    """

    STOP = 0
    ORDER = 1
    SESSION = 2
    BEATS = 3
    OLDEST = BEATS + GUARDS
    START = OLDEST + GUARDS
    CORRECTION = START + AXES
    SPEED = CORRECTION + AXES
    HOLD = SPEED + 1
    SEARCH = HOLD + 1
    PHASE = SEARCH + 1
    CAUSE = PHASE + 1
    DETAIL = CAUSE + 1
    AGE = DETAIL + 1
    STOP_CYCLES = AGE + 1
    SEARCH_TELEGRAMS = STOP_CYCLES + 1
    IPOC_STEP = SEARCH_TELEGRAMS + 1
    CYCLE = IPOC_STEP + 1
    TELEGRAMS = CYCLE + 1
    LATE = TELEGRAMS + 1
    LATE_REPORTED = LATE + 1
    LOST = LATE_REPORTED + 1
    SKIPPED = LOST + 1
    MALFORMED = SKIPPED + 1
    STALE = MALFORMED + 1
    BEYOND = STALE + 1
    FOREIGN = BEYOND + 1
    FOREIGN_FROM = FOREIGN + 1
    SENDER_PORT = FOREIGN_FROM + 1
    MARK = SENDER_PORT + 1
    FIRST_DELAY = MARK + 1
    DELAY = FIRST_DELAY + 1
    HEAD = DELAY + 1
    RING = 64


_ONLINE = Slot.RING + ROWS * _ROW_SLOTS
_SIZE = 8 * (_ONLINE + ONLINE_SLOTS)

NEVER = -(1 << 62)
"""No beat yet."""

_NO_CURRENTS = (nan,) * AXES


@final
@dataclass(frozen=True, slots=True)
class Sample:
    """One telegram: `ipoc`, `arrival_ns` of the cell's time, `joints` (AIPos) in degrees, `currents` (MACur) if any."""

    search: int
    ipoc: int
    arrival_ns: int
    joints: tuple[float, ...]
    currents: tuple[float, ...] = ()


@final
@dataclass(frozen=True, slots=True)
class SearchStatus:
    """What the cyclic process reports of the task `number`, as in `CyclicTask`."""

    number: int
    phase: Phase
    cause: Cause
    detail: int
    age_ns: int
    stop_cycles: int
    telegrams: int
    ipoc_step: int
    cycle_ns: int


@final
@dataclass(frozen=True, slots=True)
class SessionFacts:
    """A session's UDP port at the controller, its mark (0: none); Delay of the first and last answered telegram, None
    if it sends none.
    """

    port: int
    mark: int
    first_delay: int | None
    last_delay: int | None


@final
class SharedBlock:
    """A view of the shared memory behind an open file descriptor."""

    def __init__(self, fd: int) -> None:
        memory = memoryview(mmap.mmap(fd, _SIZE))
        self.words = memory.cast("q")
        self.reals = memory.cast("d")
        self.online = OnlineBlock(self.words[_ONLINE:], self.reals[_ONLINE:])

    @classmethod
    def create(cls) -> tuple[Self, int]:
        """New memory and its file descriptor, to be handed to the other process and closed."""
        fd = os.memfd_create("kuka-rsi")
        os.ftruncate(fd, _SIZE)
        block = cls(fd)
        for slot in range(GUARDS):
            block.words[Slot.BEATS + slot] = NEVER
        return block, fd

    # the engine's side

    def place_order(self, order: SearchOrder) -> None:
        """Order a search; it begins with the first telegram once its session is announced."""
        self._put_reals(Slot.START, order.start)
        self._put_reals(Slot.CORRECTION, order.correction)
        self.reals[Slot.SPEED] = order.speed_deg_s
        self.words[Slot.HOLD] = order.hold_cycles
        for slot, oldest_ns in enumerate(order.guards_ns):
            self.words[Slot.OLDEST + slot] = oldest_ns
        self.words[Slot.ORDER] = order.number

    def announce_session(self, number: int) -> None:
        """The controller has reported that RSI is on, for search `number`: its telegrams may be answered."""
        self.words[Slot.SESSION] = number

    def release(self) -> None:
        """The session is over: from now on there are no answers."""
        self.words[Slot.ORDER] = 0

    def foreign_sender(self) -> str:
        """The sender of the last datagram that did not come from the controller, `HOST:PORT`; empty if unknown."""
        packed = self.words[Slot.FOREIGN_FROM]
        return f"{IPv4Address(packed >> 16)}:{packed & 0xFFFF}" if packed else ""

    def status(self) -> SearchStatus:
        """The last state that the cyclic process published."""
        # The slots are read in the reverse order of `publish`: number, phase, cause. So the cause is at least as new as
        # the phase, and both as the number. This holds where stores become visible in program order, as on x86-64.
        words = self.words
        number, *rest = (words[slot] for slot in range(Slot.SEARCH, Slot.CYCLE + 1))
        return SearchStatus(number, Phase(rest[0]), Cause(rest[1]), *rest[2:])

    def samples(self, tail: int) -> tuple[list[Sample], int]:
        """Samples from count `tail` on that the ring still holds, and the count to continue from."""
        head = self.words[Slot.HEAD]
        first = max(tail, head - ROWS + 1)  # not the oldest row: the next telegram is written over it
        return [self._sample(count) for count in range(first, head)], head

    def session(self) -> SessionFacts:
        """The facts of the last session with a telegram."""
        port, mark, *delays = (self.words[slot] for slot in range(Slot.SENDER_PORT, Slot.DELAY + 1))
        first, last = (None if delay < 0 else delay for delay in delays)
        return SessionFacts(port, mark, first, last)

    # the cyclic process's side

    def order(self) -> SearchOrder:
        """The current order."""
        words = self.words
        oldest = tuple(words[Slot.OLDEST : Slot.OLDEST + GUARDS])
        start, correction = self._reals(Slot.START), self._reals(Slot.CORRECTION)
        speed, hold = self.reals[Slot.SPEED], words[Slot.HOLD]
        return SearchOrder(words[Slot.ORDER], start, correction, speed, oldest, hold)

    def put_foreign(self, count: int, sender: tuple[str, int] | None) -> None:
        """How many datagrams came from other senders, and the sender of the last one."""
        self.words[Slot.FOREIGN] = count
        with suppress(ValueError):  # an IPv6 address does not fit
            if sender:
                self.words[Slot.FOREIGN_FROM] = int(IPv4Address(sender[0])) << 16 | sender[1]

    def beats(self) -> memoryview:
        """Last beat of each guard, ns of the cell's time, current at each read."""
        return self.words[Slot.BEATS : Slot.BEATS + GUARDS]

    def publish(self, task: CyclicTask, telegrams: int) -> None:
        """Publish the state of `task` after `telegrams` of its telegrams."""
        words = self.words
        words[Slot.CAUSE] = task.cause
        words[Slot.DETAIL] = task.detail
        words[Slot.AGE] = task.age_ns
        words[Slot.STOP_CYCLES] = task.stop_cycles
        words[Slot.IPOC_STEP] = task.timing.ipoc_step
        words[Slot.CYCLE] = task.timing.cycle_ns
        words[Slot.PHASE] = task.phase
        words[Slot.SEARCH_TELEGRAMS] = telegrams
        words[Slot.SEARCH] = task.number

    def show_session(self, port: int, mark: int, delay: int | None, *, first: bool) -> None:
        """Keep the facts of a telegram of the session; port and mark of its first one alone."""
        if first:
            self.words[Slot.SENDER_PORT], self.words[Slot.MARK] = port, mark
            self.words[Slot.FIRST_DELAY] = -1 if delay is None else delay
        self.words[Slot.DELAY] = -1 if delay is None else delay

    def add_sample(self, sample: Sample) -> None:
        """Write a sample over the oldest."""
        count = self.words[Slot.HEAD]
        row = _row(count)
        self.words[row] = sample.search
        self.words[row + 1] = sample.ipoc
        self.words[row + 2] = sample.arrival_ns
        self._put_reals(row + 3, sample.joints)
        self._put_reals(row + 3 + AXES, sample.currents or _NO_CURRENTS)
        self.words[Slot.HEAD] = count + 1

    def _sample(self, count: int) -> Sample:
        row = _row(count)
        search, ipoc, arrival_ns = self.words[row : row + 3]
        currents = self._reals(row + 3 + AXES)
        return Sample(search, ipoc, arrival_ns, self._reals(row + 3), () if isnan(currents[0]) else currents)

    def _reals(self, first: int) -> tuple[float, ...]:
        return tuple(self.reals[first : first + AXES])

    def _put_reals(self, first: int, values: tuple[float, ...]) -> None:
        for place, value in enumerate(values, first):
            self.reals[place] = value


def _row(count: int) -> int:
    return Slot.RING + (count % ROWS) * _ROW_SLOTS
