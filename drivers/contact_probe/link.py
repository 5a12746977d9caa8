"""The conversation: a thread that reads and acknowledges, commands that are repeated, doubles that count once."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol, final

from cellctl.clock import Clock
from cellctl.devices import DeviceLost
from drivers.contact_probe.lines import Line, LineError, Splitter, encode, parse_line
from drivers.contact_probe.liveness import Liveness
from drivers.contact_probe.messages import Answer, Boot, Heartbeat, Message
from drivers.serial_port import SerialPort

_REPEAT_AFTER_S = 0.1
_TIMES = 5
_DOUBLE_WITHIN_NS = 1_000_000_000
"""A line seen again so soon is a double; the numbers come round after minutes at the earliest."""
_BOOT_WITHIN_NS = 120_000_000
"""The same for BOOT, always number 0: two repeats, so that a second reset is not taken for a double."""
_USELESS_NS = 170_000_000
"""So long without a new line, and what comes in between is of no use: spoilt, or old lines again."""
_END_BOUND_S = 10.0


@final
@dataclass(slots=True)
class Counts:
    """What went over the line since the start."""

    lines: int = 0
    crc_errors: int = 0
    doubles: int = 0
    old_lines: int = 0
    resends: int = 0


@final
@dataclass(frozen=True, slots=True)
class Arrival:
    """A line that came in for the first time: when its last character was read, and how long the wire took for it.

    `new`: it is no line of the past, nor one whose count has jumped, so that its tick can be believed.
    """

    line: Line
    time_ns: int
    wire_ns: int
    new: bool = True


@final
@dataclass(frozen=True, slots=True)
class Answered:
    """The answer to a command; when the command was first sent, and how long the wire took for it at the least."""

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
        """The port is gone. In the thread that found it out; must not block."""

    def gone(self, loss: DeviceLost) -> None:
        """The port is gone. On the loop."""


@final
class Link:
    """A conversation over an open port, from `start` to `close`."""

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
        """End the thread and let go of the port."""
        self._ending = True
        self._port.wake()
        with self._clock.standing():
            await asyncio.to_thread(self._thread.join, _END_BOUND_S)
        self._port.close()
        self._wire.close()

    def wire_ns(self, characters: int) -> int:
        """How long so many characters take on the wire, 8N1: ten bits each."""
        return characters * 10_000_000_000 // self._baud

    def silent_ns(self) -> int:
        """How long ago, in the cell's time, the probe last began a new line; 0 where something waits to be read.

        Not where what was read since has been of no use: then what waits is more of it.
        """
        useless = self._read_ns - self.last_alive_ns > _USELESS_NS
        return 0 if self._port.waiting() and not useless else self._clock.now_ns() - self.last_alive_ns

    def why_not_alive(self) -> str:
        """Why the lines that come in are no proof of life; empty where none come, or good ones."""
        return "" if self._clock.now_ns() - self._line_ns > _USELESS_NS else self._liveness.reason

    def check(self) -> None:
        """Raises DeviceLost where the port is gone."""
        if self._why_gone:
            raise self._loss()

    async def ask(self, kind: str) -> Answered:
        """Send a command until it is answered.

        Raises TimeoutError after the fifth time, DeviceLost where the port is gone.
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
        except Exception as error:  # whatever ends this thread is the loss of the device, never silence
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
        if not double:  # after the acknowledgement: what the loop sends upon this line goes onto the wire behind it
            arrival = Arrival(line, time_ns, self.wire_ns(len(raw)), new=late_ns is not None)
            self._on_loop(lambda: self._take(arrival))

    def _is_double(self, line: Line, time_ns: int) -> bool:
        """The same number saying the same again soon. Heartbeats, never sent again, may well be alike after a reset."""
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
            return  # an old answer may bear the awaited number: they begin at 0 with each connection
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
