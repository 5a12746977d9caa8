"""The link: a thread that reads and acknowledges lines, repeated commands, and duplicates that count once."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol, final

from cellctl.clock import Clock
from cellctl.devices import DeviceLost
from drivers.contact_probe.lines import Answer, Boot, Heartbeat, Line, LineError, Message, Splitter, encode, parse_line
from drivers.contact_probe.ticks import Liveness
from drivers.serial_port import SerialPort

_REPEAT_AFTER_S = 0.1
_TIMES = 5
_DOUBLE_WITHIN_NS = 1_000_000_000
"""A line received again within this time is a duplicate; the numbers wrap after minutes at the earliest."""
_BOOT_WITHIN_NS = 120_000_000
"""The same for BOOT, always number 0: two repeats, so that a second reset does not count as a duplicate."""
_USELESS_NS = 170_000_000
"""After this time without a new line, the received lines are useless: corrupted or repeated."""
_END_BOUND_S = 10.0


@final
@dataclass(slots=True)
class Counts:
    """Counts of the line since the start."""

    lines: int = 0
    crc_errors: int = 0
    doubles: int = 0
    old_lines: int = 0
    resends: int = 0


@final
@dataclass(frozen=True, slots=True)
class Arrival:
    """A line received for the first time: the time of its last character, and its transmission time.

    `new`: it is neither an old line nor one whose count has jumped, so that its tick is reliable.
    """

    line: Line
    time_ns: int
    wire_ns: int
    new: bool = True


@final
@dataclass(frozen=True, slots=True)
class Answered:
    """The answer to a command; the time of its first sending, and its least transmission time."""

    arrival: Arrival
    sent_ns: int
    wire_ns: int

    @property
    def message(self) -> Message:
        """The content of the answer."""
        return self.arrival.line.message


class Hearer(Protocol):
    """The listener of a link."""

    def alive(self, time_ns: int) -> None:
        """The probe was alive at `time_ns`: it began a new line then. In the port's thread; must not block."""

    def at_once(self, line: Line) -> None:
        """A valid line, once, before it is acknowledged. In the port's thread; must not block."""

    def arrived(self, arrival: Arrival) -> None:
        """A valid line, once. On the loop."""

    def gone_at_once(self) -> None:
        """The port was lost. In the thread that detected it; must not block."""

    def gone(self, loss: DeviceLost) -> None:
        """The port was lost. On the loop."""


@final
class Link:
    """The link over an open port, from `start` to `close`."""

    def __init__(self, device: str, port: SerialPort, baud: int, clock: Clock, hearer: Hearer) -> None:
        self.counts = Counts()
        self.last_alive_ns = clock.now_ns()
        self._device, self._port, self._baud, self._clock, self._hearer = device, port, baud, clock, hearer
        self._liveness = Liveness()
        self._read_ns = self._line_ns = self.last_alive_ns
        self._seen: dict[int, tuple[Message, int]] = {}
        self._next_seq = 0
        self._asking = asyncio.Lock()
        self._writing = threading.Lock()
        self._awaited: tuple[int, asyncio.Future[Arrival]] | None = None
        self._why_gone = ""
        self._ending = False
        self._loop = asyncio.get_running_loop()
        self._wire = clock.wire(device)
        self._thread = threading.Thread(target=self._listen, name=f"{device} port", daemon=True)

    def start(self) -> None:
        """Begin to listen."""
        self._thread.start()

    async def close(self) -> None:
        """End the thread and close the port."""
        self._ending = True
        self._port.wake()
        with self._clock.standing():
            await asyncio.to_thread(self._thread.join, _END_BOUND_S)
        self._port.close()
        self._wire.close()

    def wire_ns(self, characters: int) -> int:
        """Transmission time of this number of characters, 8N1: ten bits each."""
        return characters * 10_000_000_000 // self._baud

    def silent_ns(self) -> int:
        """Time, in the cell's time, since the probe last began a new line; 0 if unread data wait.

        Unread data do not count if the lines read since were useless.
        """
        useless = self._read_ns - self.last_alive_ns > _USELESS_NS
        return 0 if self._port.waiting() and not useless else self._clock.now_ns() - self.last_alive_ns

    def why_not_alive(self) -> str:
        """Why the received lines are no proof of life; empty without lines, or if they are valid."""
        return "" if self._clock.now_ns() - self._line_ns > _USELESS_NS else self._liveness.reason

    def check(self) -> None:
        """Raises DeviceLost if the port was lost."""
        if self._why_gone:
            raise self._loss()

    async def ask(self, kind: str) -> Answered:
        """Send a command until it is answered.

        Raises TimeoutError after the fifth time, DeviceLost if the port was lost.
        """
        async with self._asking:
            seq, self._next_seq = self._next_seq, (self._next_seq + 1) % 0x10000
            answer: asyncio.Future[Arrival] = self._loop.create_future()
            self._awaited = seq, answer
            line = encode(kind, seq)
            sent_ns = self._clock.now_ns()
            try:
                return Answered(await self._repeated(line, answer), sent_ns, self.wire_ns(len(line)))
            finally:
                self._awaited = None

    async def _repeated(self, line: bytes, answer: asyncio.Future[Arrival]) -> Arrival:
        for time in range(_TIMES):
            self.counts.resends += time > 0
            self._send(line)
            self.check()
            with suppress(TimeoutError):
                async with self._clock.timeout(_REPEAT_AFTER_S):
                    return await asyncio.shield(answer)
            self.check()
        raise TimeoutError

    def _send(self, line: bytes) -> None:
        try:
            with self._writing:
                self._port.write(line)
                self._wire.wrote(len(line))
        except OSError as error:
            self._lose(f"the port takes nothing more ({error})")

    def _listen(self) -> None:
        splitter = Splitter()
        try:
            while not self._ending and not self._why_gone:
                data = self._port.read()
                time_ns = self._clock.now_ns()
                if data:
                    self._read_ns = time_ns
                for raw in splitter.feed(data):
                    self._hear(raw, time_ns)
                self._wire.read(len(data))
        except Exception as error:  # report any end of this thread as loss of the device
            self._lose(f"the port is gone ({error})")

    def _hear(self, raw: bytes, time_ns: int) -> None:
        try:
            line = parse_line(raw)
        except LineError:
            self.counts.crc_errors += 1
            return
        self.counts.lines += 1
        self._line_ns = time_ns
        double = self._is_double(line, time_ns)
        late_ns = self._liveness.lateness_ns(line, time_ns, double=double)
        self.counts.old_lines += late_ns is None
        if late_ns is not None and not double:
            self.last_alive_ns = time_ns - late_ns
            self._hearer.alive(self.last_alive_ns)
        if not double:
            self._hearer.at_once(line)
        self._send(encode("ACK", line.seq))
        if not double:  # after the acknowledgement: replies from the loop are sent behind it
            arrival = Arrival(line, time_ns, self.wire_ns(len(raw)), new=late_ns is not None)
            self._on_loop(lambda: self._take(arrival))

    def _is_double(self, line: Line, time_ns: int) -> bool:
        """The same number and content again soon. Heartbeats are never repeated, but can be equal after a reset."""
        if isinstance(line.message, Heartbeat):
            return False
        seen, last_ns = self._seen.get(line.seq, (None, 0))
        within_ns = _BOOT_WITHIN_NS if isinstance(line.message, Boot) else _DOUBLE_WITHIN_NS
        double = seen == line.message and time_ns - last_ns < within_ns
        self._seen[line.seq] = line.message, time_ns
        self.counts.doubles += double
        return double

    def _take(self, arrival: Arrival) -> None:
        self._hearer.arrived(arrival)
        message = arrival.line.message
        if not arrival.new:
            return  # an old answer may have the expected number: numbers begin at 0 with each connection
        if self._awaited and isinstance(message, Answer) and message.host_seq == self._awaited[0]:
            _, answer = self._awaited
            if not answer.done():
                answer.set_result(arrival)

    def _lose(self, why: str) -> None:
        if self._ending or self._why_gone:
            return
        self._why_gone = why
        self._wire.close()
        self._hearer.gone_at_once()
        self._on_loop(self._take_loss)

    def _take_loss(self) -> None:
        if self._awaited and not self._awaited[1].done():
            self._awaited[1].set_exception(self._loss())
        self._hearer.gone(self._loss())

    def _loss(self) -> DeviceLost:
        return DeviceLost(self._device, self._why_gone, "check the cable and the probe's supply")

    def _on_loop(self, call: Callable[[], object]) -> None:
        with suppress(RuntimeError):  # the loop has ended before this thread
            self._loop.call_soon_threadsafe(call)
