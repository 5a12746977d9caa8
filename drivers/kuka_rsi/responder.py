"""Answers the controller: receive, read stop and guards, plan, reply; in this order, once for the newest telegram."""

from __future__ import annotations

import socket
from typing import Any, final

from cellctl.clock.reading import TimeReader
from drivers.kuka_rsi.correction_mode import CorrectionMode
from drivers.kuka_rsi.cycle_timing import AnswerDelay
from drivers.kuka_rsi.limits import AXES, SearchLimits
from drivers.kuka_rsi.search_cycle import SearchCycle
from drivers.kuka_rsi.shared_block import Sample, SharedBlock, Slot
from drivers.kuka_rsi.telegram import ReplyFormat, Telegram, read_telegram

_LARGEST_DATAGRAM = 65535


@final
class Responder:
    """The cyclic process's work on one bound, non-blocking UDP socket."""

    def __init__(
        self,
        line: socket.socket,
        block: SharedBlock,
        reply: ReplyFormat,
        limits: SearchLimits,
        clock: TimeReader,
        mode: CorrectionMode = CorrectionMode.ABSOLUTE,
    ) -> None:
        self._line = line
        self._block = block
        self._reply = reply
        self._limits = limits
        self._clock = clock
        self._mode = mode
        self._beats = block.beats()
        self._search: SearchCycle | None = None
        self._telegrams = 0
        self._delay: AnswerDelay = AnswerDelay()
        self._reported: int | None = None

    @property
    def searching(self) -> bool:
        """Whether a search has been ordered and not been released."""
        return self._search is not None

    def answer(self, *, leave: bool = False) -> None:
        """Answer the newest telegram that waits; the older ones are kept as samples and counted as skipped."""
        waiting = self._receive()
        now_ns = self._clock()
        self.take_order()
        if not waiting:
            return
        for telegram, _ in waiting:
            self._take_in(telegram, now_ns)
        newest, sender = waiting[-1]
        self._count(Slot.SKIPPED, len(waiting) - 1)
        self._send(self._plan(newest, now_ns, leave, skipped=len(waiting) - 1), sender)
        self._count_late(newest, now_ns)

    def take_order(self) -> None:
        """Look whether a search was ordered or released since."""
        number = self._block.words[Slot.ORDER]
        if number == (self._search.order.number if self._search else 0):
            return
        self._search = SearchCycle(self._block.order(), self._limits, self._mode) if number else None
        self._telegrams = 0
        self._delay = AnswerDelay()
        if self._search:
            self._block.publish(self._search, 0)

    def _receive(self) -> list[tuple[Telegram, Any]]:
        """Every readable telegram that waits, in the order of arrival, with its sender."""
        waiting: list[tuple[Telegram, Any]] = []
        while True:
            try:
                datagram, sender = self._line.recvfrom(_LARGEST_DATAGRAM)
            except BlockingIOError:
                return waiting
            try:
                waiting.append((read_telegram(datagram), sender))
            except ValueError:
                self._count(Slot.MALFORMED)

    def _take_in(self, telegram: Telegram, now_ns: int) -> None:
        self._count(Slot.TELEGRAMS)
        self._count_reported(telegram)
        if self._search:
            self._telegrams += 1
            self._block.add_sample(Sample(self._search.order.number, telegram.ipoc, now_ns, telegram.joints))

    def _plan(self, telegram: Telegram, now_ns: int, leave: bool, skipped: int) -> bytes:
        search = self._search
        if search is None:
            return self._reply.write((0.0,) * AXES, False, telegram.ipoc_text)
        stopped = self._block.words[Slot.STOP] == search.order.number
        missed_before = search.missed
        correction, stop = search.answer(telegram, now_ns, stopped, self._beats, leave=leave)
        self._count(Slot.LOST, max(0, search.missed - missed_before - skipped))
        self._block.publish(search, self._telegrams)
        return self._reply.write(correction, stop, telegram.ipoc_text)

    def _send(self, reply: bytes, sender: Any) -> None:
        try:
            self._line.sendto(reply, sender)
        except OSError:  # the sender's socket is gone; it counts the answer as late
            self._count(Slot.LATE)

    def _count_late(self, telegram: Telegram, now_ns: int) -> None:
        timing = self._search.timing if self._search else None
        if timing is None or not timing.learnt:
            return
        sent_ns = telegram.ipoc * timing.cycle_ns // timing.ipoc_step
        self._delay.arrived(sent_ns, now_ns)
        if self._delay.of(sent_ns, self._clock()) > timing.cycle_ns:
            self._count(Slot.LATE)

    def _count_reported(self, telegram: Telegram) -> None:
        """Controllers differ in whether a good answer sets their count back: only its rises are summed."""
        before, self._reported = self._reported, telegram.delay
        if before is not None and telegram.delay is not None:
            self._count(Slot.LATE_REPORTED, max(0, telegram.delay - before))

    def _count(self, slot: Slot, number: int = 1) -> None:
        self._block.words[slot] += number
