"""Answers the controller on a UDP line that accepts only it: receive, read stop and guards, plan, reply.

**One cycle.** Every interpolation cycle T (4 or 12 ms) the controller sends a telegram with its count IPOC, whatever
comes back, and takes the answer that repeats this IPOC. An answer after the cycle's end counts as late; after
`Timeout` of them the controller ends RSI and stops (KSS29002). So an answer has T less the network's delay. Its parts,
in this order: all datagrams that wait are read (`receive`), so that a stall does not leave every later answer one
telegram behind; orders, the stop and the guards' beats are read from shared memory as late as possible, so that a
contact counts in the cycle in which it arrives; the task plans the correction of the *newest* telegram; the reply is
written from a template and sent; counts and samples follow only for the engine. Telegrams that were not the newest are
kept as samples and counted as skipped.

**Late, lost, skipped.** The computers' clocks are not compared: the least delay of many telegrams, arrival less IPOC ×
T, is the delay without waiting, and an answer is late if it left more than T after that. Lost is a gap in IPOC;
skipped was received and not answered.

**When it does not answer.** It answers only from the order of a task and the announcement of its session to the
release. Not answering is safe: a session's output begins at zero, and later it is held. Answering zero is not safe:
with absolute corrections it sends the robot back to the pose of RSI_ON in one cycle.
"""

from __future__ import annotations

import ctypes
import ipaddress
import socket
import struct
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Self, final

from cellctl.clock import TimeReader
from drivers.kuka_rsi.cyclic.session import Admission, AnswerDelay, CyclicTask, Phase, SearchOrder
from drivers.kuka_rsi.cyclic.shared_block import Sample, SharedBlock, Slot
from drivers.kuka_rsi.cyclic.telegram import ReplyFormat, Telegram, read_telegram

Place = Any
"""The sender of a datagram, as the socket reports it: (host, port, …)."""

_LARGEST_DATAGRAM = 65535

_MOST_AT_ONCE = 512
"""Datagrams read at once. A stall of 2 s at 4 ms leaves this many telegrams, more than any controller tolerates; a
flood must not delay the newest answer."""

_BUFFER = 1 << 20
"""Bytes that the kernel buffers, if it grants this size (net.core.rmem_max): 2 s of telegrams of 2 KiB."""

_UNFILTERED = 16
"""Number of foreign datagrams that are read to name their sender; then the kernel drops them."""

_SO_ATTACH_FILTER = 26
_SO_MEMINFO = 55
"""Linux: asm-generic/socket.h; Python's `socket` names neither."""

_MEMINFO = struct.Struct("=9I")
"""The ninth counts the datagrams that the kernel dropped."""
_SOURCE_ADDRESS = 0xFFF00000 + 12
"""Of the IPv4 header, to a socket filter (SKF_NET_OFF)."""


@final
class ControllerLine:
    """A non-blocking socket that accepts the host `controller` (an address as `recvfrom` writes it).

    `foreign`: datagrams from other senders, with those that the kernel dropped; `last_foreign`: the sender of
    the last one that was read.
    """

    def __init__(self, line: socket.socket, controller: str) -> None:
        self.last_foreign: tuple[str, int] | None = None
        self._line = line
        self._controller = controller
        self._seen_foreign = 0
        self._filtered = False

    @classmethod
    def bind(cls, host: str, port: int, controller: str) -> Self:
        """Bound exclusively: with SO_REUSEADDR another program could silently take the telegrams. Raises OSError."""
        family, kind, protocol, _, place = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        flags = socket.AI_V4MAPPED if family == socket.AF_INET6 else 0
        heard = socket.getaddrinfo(controller, 0, family, socket.SOCK_DGRAM, flags=flags)[0][4][0]
        line = socket.socket(family, kind, protocol)
        line.setblocking(False)
        line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
        line.bind(place)
        return cls(line, str(heard))

    def fileno(self) -> int:
        """The socket's descriptor, to wait for."""
        return self._line.fileno()

    @property
    def place(self) -> tuple[str, int]:
        """Host and port bound."""
        host, port = self._line.getsockname()[:2]
        return host, port

    @property
    def foreign(self) -> int:
        """Datagrams that did not come from the controller."""
        return self._seen_foreign + self._dropped()

    def receive(self) -> list[tuple[bytes, Place]]:
        """The waiting datagrams of the controller, in the order of arrival, with their senders; limited in number."""
        heard = []
        for _ in range(_MOST_AT_ONCE):
            try:
                datagram, sender = self._line.recvfrom(_LARGEST_DATAGRAM)
            except BlockingIOError:
                break
            if sender[0] == self._controller:
                heard.append((datagram, sender))
            else:
                self.count_foreign(sender)
        return heard

    def count_foreign(self, sender: Place) -> None:
        """A datagram came from a sender that is not, or no longer, the controller's RSI."""
        self.last_foreign = sender[0], sender[1]
        self._seen_foreign += 1
        if self._seen_foreign == _UNFILTERED:
            with suppress(OSError, ValueError):  # other kernels, or IPv6: foreign datagrams are still dropped here
                self._attach_filter()

    def send(self, reply: bytes, place: Place) -> None:
        """Send. Raises OSError."""
        self._line.sendto(reply, place)

    def close(self) -> None:
        """Close the port."""
        self._line.close()

    def _attach_filter(self) -> None:
        """A classic BPF program: pass datagrams from the controller's IPv4 address, drop the rest."""
        # load the source address; equal: next, else skip one; return all bytes; return none (linux/filter.h)
        address = int(ipaddress.IPv4Address(self._controller))
        program = ((0x20, 0, 0, _SOURCE_ADDRESS), (0x15, 0, 1, address), (0x06, 0, 0, 0xFFFFFFFF), (0x06, 0, 0, 0))
        code = ctypes.create_string_buffer(b"".join(struct.pack("=HBBI", *instruction) for instruction in program))
        pointer = struct.pack("@HP", len(program), ctypes.addressof(code))
        self._line.setsockopt(socket.SOL_SOCKET, _SO_ATTACH_FILTER, pointer)
        self._filtered = True

    def _dropped(self) -> int:
        if not self._filtered:
            return 0
        figures = self._line.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _MEMINFO.size)
        return int(_MEMINFO.unpack(figures)[-1])


_SHORTEST_CYCLE_NS = 4_000_000
"""An older telegram is of an earlier cycle, and may be of another session.

The cycle is not learnt yet, so at 12 ms this leaves a telegram unanswered that could be answered: one cycle is missed.
"""


@final
@dataclass(frozen=True, slots=True)
class _Waiting:
    """A telegram that is not answered yet."""

    telegram: Telegram
    sender: Place
    arrival_ns: int


@final
class Responder:
    """The cyclic process's work on the controller's line; `task_of` makes the task of an order."""

    def __init__(
        self,
        line: ControllerLine,
        block: SharedBlock,
        reply: ReplyFormat,
        clock: TimeReader,
        task_of: Callable[[SearchOrder], CyclicTask],
    ) -> None:
        self._line = line
        self._block = block
        self._reply = reply
        self._clock = clock
        self._task_of = task_of
        self._beats = block.beats()
        self._foreign = 0
        self._expect(None)

    @property
    def busy(self) -> bool:
        """Whether a task has been ordered and not been released."""
        return self._task is not None

    @property
    def waits_for_announcement(self) -> bool:
        """Whether a telegram of this cycle waits for the announcement of its session."""
        return bool(self._early)

    def answer(self, *, leave: bool = False) -> None:
        """Check orders and line once, and answer the newest admissible telegram.

        The older ones are kept as samples and counted as skipped.
        """
        received = self._line.receive()
        now_ns = self._clock()
        self.take_order()
        admitted = self._admitted(self._current(received, now_ns))
        self._show_foreign()
        if self._task and admitted:
            self._answer_newest(self._task, admitted, now_ns, leave)

    def take_order(self) -> None:
        """Check whether a task was ordered or released since."""
        number = self._block.words[Slot.ORDER]
        if number == (self._task.number if self._task else 0):
            return
        self._expect(self._task_of(self._block.order()) if number else None)
        if self._task:
            self._block.publish(self._task, 0)  # the engine sees that the order is taken, and a model prepared

    def _expect(self, task: CyclicTask | None) -> None:
        """From now on answer only telegrams of the session of `task`; without a task, none."""
        self._task = task
        self._sender: Place | None = None
        self._early: list[_Waiting] = []
        self._telegrams = 0
        self._delay = AnswerDelay()
        self._reported: int | None = None

    def _current(self, received: list[tuple[bytes, Place]], now_ns: int) -> list[_Waiting]:
        """The waiting telegrams; none before the session is announced, but the newest is kept for its cycle."""
        waiting = self._early + self._read(received, now_ns)
        self._early = []
        if self._sender is None:  # none was answered yet: older ones may belong to another session
            waiting = [one for one in waiting[-1:] if now_ns - one.arrival_ns < _SHORTEST_CYCLE_NS]
        if self._task and self._block.words[Slot.SESSION] != self._task.number:
            self._early, waiting = waiting, []
        return waiting

    def _read(self, received: list[tuple[bytes, Place]], now_ns: int) -> list[_Waiting]:
        """The controller's readable telegrams; the session's first one shows its port."""
        waiting = []
        for datagram, sender in received:
            if self._sender not in (None, sender):
                self._line.count_foreign(sender)
                continue
            try:
                waiting.append(_Waiting(read_telegram(datagram), sender, now_ns))
            except ValueError:
                self._count(Slot.MALFORMED)
        self._count(Slot.TELEGRAMS, len(waiting))
        return waiting

    def _admitted(self, waiting: list[_Waiting]) -> list[_Waiting]:
        task = self._task
        return [one for one in waiting if self._admit(task, one)] if task else []

    def _admit(self, task: CyclicTask, one: _Waiting) -> bool:
        self._sender = one.sender
        admission = task.admit(one.telegram)
        if admission is Admission.STALE:
            self._count(Slot.STALE)
        elif admission is Admission.BEYOND:
            self._count(Slot.BEYOND)
            self._block.publish(task, self._telegrams)
        return admission is Admission.ANSWERABLE

    def _answer_newest(self, task: CyclicTask, admitted: list[_Waiting], now_ns: int, leave: bool) -> None:
        """Shared data do not change after the reply is sent: in lockstep the reply advances the cell's time."""
        if task.phase is Phase.OVER:  # by a later telegram among these
            return
        for one in admitted:
            self._take_in(task, one, now_ns)
        newest = admitted[-1]
        self._count(Slot.SKIPPED, len(admitted) - 1)
        reply = self._plan(task, newest.telegram, now_ns, leave, skipped=len(admitted) - 1)
        self._count_late(task, newest.telegram, now_ns)
        try:
            self._line.send(reply, newest.sender)
        except OSError:  # the sender's socket is closed; it counts the answer as late
            self._count(Slot.LATE)

    # `now_ns` is when the queue was read. That is too late for the older telegrams of a stall; the fit of the clocks
    # takes the least delays and ignores them.
    def _take_in(self, task: CyclicTask, one: _Waiting, now_ns: int) -> None:
        telegram = one.telegram
        self._telegrams += 1
        self._block.show_session(one.sender[1], telegram.mark, telegram.delay, first=self._telegrams == 1)
        self._count_reported(telegram)
        self._block.add_sample(Sample(task.number, telegram.ipoc, now_ns, telegram.joints, telegram.currents or ()))

    def _plan(self, task: CyclicTask, telegram: Telegram, now_ns: int, leave: bool, skipped: int) -> bytes:
        stopped = self._block.words[Slot.STOP] != 0
        missed_before = task.missed
        correction, stop = task.answer(telegram, now_ns, stopped, self._beats, leave=leave)
        self._count(Slot.LOST, max(0, task.missed - missed_before - skipped))
        self._block.publish(task, self._telegrams)
        return self._reply.write(correction, stop, telegram.ipoc_text)

    def _count_late(self, task: CyclicTask, telegram: Telegram, now_ns: int) -> None:
        timing = task.timing
        if not timing.learnt:
            return
        sent_ns = telegram.ipoc * timing.cycle_ns // timing.ipoc_step  # of the controller's clock
        self._delay.arrived(sent_ns, now_ns)
        if self._delay.of(sent_ns, self._clock()) > timing.cycle_ns:
            self._count(Slot.LATE)

    def _count_reported(self, telegram: Telegram) -> None:
        """On some controllers a valid answer resets the count: only its rises are summed."""
        before, self._reported = self._reported, telegram.delay
        if before is not None and telegram.delay is not None:
            self._count(Slot.LATE_REPORTED, max(0, telegram.delay - before))

    def _show_foreign(self) -> None:
        if (count := self._line.foreign) != self._foreign:
            self._foreign = count
            self._block.put_foreign(count, self._line.last_foreign)

    def _count(self, slot: Slot, number: int = 1) -> None:
        self._block.words[slot] += number
