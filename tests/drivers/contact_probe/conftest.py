"""A scripted probe on a pseudo terminal, written from docs/reference/probe-protocol.md alone, and the time it owns.

Time is the script's: it stands still until each line is acknowledged, so nothing here depends on how fast the machine
is. Wall time only bounds the waiting for an answer that does not come.
"""

from __future__ import annotations

import asyncio
import heapq
import itertools
import os
import random
import threading
import tty
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from types import SimpleNamespace

import pytest

from cellctl.clock import Clock
from cellctl.devices import Address, Surroundings
from drivers.contact_probe.description import open_probe
from drivers.serial_port import SerialPort

MS = 1_000_000
TICK_HZ = 2_000_000
BAUD = 250_000
PATIENCE_S = 60.0


def crc_bit_by_bit(body: bytes) -> int:
    """CRC-16/CCITT-FALSE straight from its definition; the driver uses another implementation."""
    crc = 0xFFFF
    for byte in body:
        crc ^= byte << 8
        for _ in range(8):
            crc = ((crc << 1) ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


def framed(body: str) -> bytes:
    return body.encode() + b"*%04X\n" % crc_bit_by_bit(body.encode())


class ReadWire:
    """Counts what the driver has read and handed on to its loop."""

    def __init__(self) -> None:
        self.bytes_read, self.closed = 0, False

    def wrote(self, count: int) -> None:
        pass

    def read(self, count: int) -> None:
        self.bytes_read += count

    def close(self) -> None:
        self.closed = True


class ScriptedClock(Clock):
    """Time that moves only when the script moves it."""

    source = "scripted"

    def __init__(self) -> None:
        self.time_ns = 7_000 * MS
        self.host_wire: ReadWire | None = None
        self._timers: list[tuple[int, int, SimpleNamespace]] = []
        self._order = itertools.count()

    def now_ns(self) -> int:
        return self.time_ns

    def wire(self, device: str) -> ReadWire:
        self.host_wire = ReadWire()
        return self.host_wire

    def call_later(self, seconds: float, callback: Callable[[], object]):
        timer = SimpleNamespace(callback=callback, live=True)
        timer.cancel = lambda: setattr(timer, "live", False)
        heapq.heappush(self._timers, (self.time_ns + round(seconds * 1e9), next(self._order), timer))
        return timer

    def next_due(self) -> int | None:
        while self._timers and not self._timers[0][2].live:
            heapq.heappop(self._timers)
        return self._timers[0][0] if self._timers else None

    def fire_next(self) -> None:
        due, _, timer = heapq.heappop(self._timers)
        self.time_ns = max(self.time_ns, due)
        timer.callback()


class FakeProbe:
    """Speaks the protocol's other end. What a test wants to go wrong, it sets."""

    def __init__(self) -> None:
        self.clock = ScriptedClock()
        self.state, self.loop_mv, self.proto, self.serial = "DISARMED", 1650, 1, "SIM-1"
        self.replies: dict[str, list[str]] = {"ARM": [], "DISARM": []}  # codes to give next, else what is true
        self.drift, self.first_tick = 0.0, 0
        self.stands_at: int | None = None  # the count, where its timer hangs
        self.delay_ns: Callable[[], int] = lambda: 0  # what the adapter adds to a line on its way to the host
        self.answering, self.beating, self.silent = True, True, False
        self.deaf_to: Counter[str] = Counter()  # how many commands of a kind get lost
        self.spoil: Counter[str] = Counter()  # how many lines of a kind are spoilt on the way
        self.forget_ack: Counter[str] = Counter()  # how many acknowledgements of a kind get lost
        self.commands: list[str] = []
        self.command_seq, self.command_ns = "", 0  # of the last one
        self.lines: list[bytes] = []  # all that have arrived, as they were
        self.acked: list[int] = []
        self.on_ack: Callable[[int], None] = lambda _seq: None
        self.events: list[tuple[int, int, Callable[[], Awaitable[None]]]] = []
        self._order = itertools.count()
        self._seq = 0
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.path = os.ttyname(self._slave)
        self.sent = self._heard = 0  # bytes on the host's line: written there, read here
        self._got = b""
        self._last_command: tuple[str, str] | None = None

    def tick(self, time_ns: int | None = None) -> int:
        if self.stands_at is not None:
            return self.stands_at
        time_ns = self.clock.time_ns if time_ns is None else time_ns
        return (self.first_tick + round(time_ns * (1 + self.drift) * TICK_HZ / 1e9)) % 2**32

    def at(self, time_ns: int, action: Callable[[], object]) -> None:
        """Do `action` (or start it, where it is a coroutine function) at `time_ns`."""

        async def act() -> None:
            result = action()
            if asyncio.iscoroutine(result):
                await result

        heapq.heappush(self.events, (time_ns, next(self._order), act))

    def after(self, ms: float, action: Callable[[], object]) -> None:
        self.at(self.clock.time_ns + round(ms * MS), action)

    def say(self, kind: str, *fields: object) -> int:
        """Begin to send a line now; it arrives after its wire time and delay, and again until acknowledged."""
        seq, self._seq = self._seq, (self._seq + 1) % 65536
        self._transmit(kind, seq, fields)
        return seq

    def again(self, line: bytes | str) -> None:
        """A line as it is, with its number and its count, comes in now. Where it is text, it is given its CRC."""
        line = framed(line) if isinstance(line, str) else line
        seq = int(line.split(b",")[1])
        self.at(self.clock.time_ns, lambda: self._arrive("HB", seq, (), line))

    def run_at(self, rate: float) -> None:
        """From now on the clock runs at `rate` times what it should."""
        count, self.drift = self.tick(), rate - 1.0
        self.first_tick += count - self.tick()

    def raw(self, data: bytes) -> None:
        os.write(self._master, data)

    def touch(self) -> int:
        """Close the loop now: EDGE at once, CONF 2 ms later. Returns the tick of the edge."""
        edge = self.tick()
        self.state, self.loop_mv = "TRIPPED", 80
        self.say("EDGE", edge)
        self.after(2, lambda: self.say("CONF", edge, 1, 3))
        return edge

    def fault(self, code: str) -> None:
        self.state, self.loop_mv = "FAULT", 4900 if code == "WIRE" else self.loop_mv
        self.say("FAULT", code)

    def reset(self) -> None:
        self.state, self._seq, self._last_command = "DISARMED", 0, None
        self.first_tick = 1000 - round(self.clock.time_ns * (1 + self.drift) * TICK_HZ / 1e9)
        self.say("BOOT", 1, "WATCHDOG")

    def hang_up(self) -> None:
        asyncio.get_running_loop().remove_reader(self._master)
        os.close(self._master)
        os.close(self._slave)
        self._master = -1

    async def live(self) -> None:
        """Move time from event to event, for as long as the test goes on."""
        if self.beating:
            self.after(50, self._beat)
        while True:
            await self._let_things_settle()
            timer = self.clock.next_due()
            event = self.events[0][0] if self.events else None
            if timer is not None and (event is None or timer <= event):
                if self._master >= 0 and self._heard < self.sent:  # what is on its way comes before a time-out
                    await self._input(PATIENCE_S)
                    continue
                self.clock.fire_next()
            elif event is not None:
                _, _, act = heapq.heappop(self.events)
                self.clock.time_ns = max(self.clock.time_ns, event)
                await act()
            else:
                await asyncio.sleep(0.001)

    async def _let_things_settle(self) -> None:
        for _ in range(12):
            await asyncio.sleep(0)
        self._read()

    def _beat(self) -> None:
        self.after(50, self._beat)
        if self.beating:
            self.say("HB", self.state, self.loop_mv, 1)

    def _transmit(self, kind: str, seq: int, fields: tuple[object, ...]) -> None:
        if self.silent or self._master < 0:
            return
        line = framed(",".join(map(str, (kind, seq, self.tick(), *fields))))
        arrival = self.clock.time_ns + len(line) * 10 * 10**9 // BAUD + self.delay_ns()
        self.at(arrival, lambda: self._arrive(kind, seq, fields, line))

    async def _arrive(self, kind: str, seq: int, fields: tuple[object, ...], line: bytes) -> None:
        if self._master < 0:
            return
        spoilt = self.spoil[kind] > 0
        if spoilt:
            self.spoil[kind] -= 1
            line = line[:3] + bytes([line[3] ^ 0x05]) + line[4:]
        self.acked.clear()
        self.lines.append(line)
        listener = next((t for t in threading.enumerate() if t.name == "probe port"), None)
        wire = self.clock.host_wire
        before = wire.bytes_read if wire else 0
        os.write(self._master, line)
        acked = not spoilt and listener is not None and await self._acknowledged(seq, listener)
        while acked and wire and not wire.closed and wire.bytes_read < before + len(line):
            await asyncio.sleep(0)  # acknowledged, and about to be handed to the driver's loop
        if acked and self.forget_ack[kind] > 0:
            self.forget_ack[kind] -= 1
            acked = False
        if not acked and kind != "HB":
            self.after(50, lambda: self._transmit(kind, seq, fields))

    async def _acknowledged(self, seq: int, listener: threading.Thread) -> bool:
        with suppress(TimeoutError):
            async with asyncio.timeout(PATIENCE_S):
                while listener.is_alive() and seq not in self.acked:
                    await self._input(0.05)
                return seq in self.acked
        raise AssertionError(f"line {seq} was not acknowledged")

    async def _input(self, patience_s: float) -> None:
        """Wait for input for up to `patience_s` of wall time."""
        loop, ready = asyncio.get_running_loop(), asyncio.Event()
        if self._master < 0:
            return
        loop.add_reader(self._master, ready.set)
        with suppress(TimeoutError):
            async with asyncio.timeout(patience_s):
                await ready.wait()
        if self._master >= 0:
            loop.remove_reader(self._master)
        self._read()

    def _read(self) -> None:
        if self._master < 0:
            return
        with suppress(BlockingIOError):
            data = os.read(self._master, 4096)
            self._heard += len(data)
            self._got += data
        *lines, self._got = self._got.split(b"\n")
        for line in lines:
            body, _, crc = line.rpartition(b"*")
            assert int(crc, 16) == crc_bit_by_bit(body), line
            self._hear(*body.decode().split(","), wire_ms=(len(line) + 1) * 10 * 1000 / BAUD)

    def _hear(self, kind: str, seq: str, wire_ms: float) -> None:
        if kind == "ACK":
            self.on_ack(int(seq))
            self.acked.append(int(seq))
            return
        self.commands.append(kind)
        self.command_seq, self.command_ns = seq, self.clock.time_ns
        if self.deaf_to[kind] > 0:
            self.deaf_to[kind] -= 1
        elif self.answering:
            first_time = (kind, seq) != self._last_command
            self._last_command = kind, seq
            self.after(wire_ms, lambda: self._answer(kind, seq, first_time))

    def _answer(self, kind: str, seq: str, first_time: bool) -> None:
        if kind == "HELLO":
            self.say("ID", seq, self.proto, "fw 1.2", "scripted", self.serial, TICK_HZ, "POWER")
        elif kind == "SYNC":
            self.say("SYNC", seq, self.tick())
        else:
            self.say("RE", seq, self._obey(kind) if first_time else "OK")

    def _obey(self, kind: str) -> str:
        if self.replies[kind]:
            return self.replies[kind].pop(0)
        if kind == "ARM" and self.state != "DISARMED":
            return "STATE"
        if kind == "ARM" and self.loop_mv < 500:
            return "CLOSED"
        self.state = "ARMED" if kind == "ARM" else "DISARMED"
        return "OK"


class Stop:
    """What the robot would do: remember that it was told to stop, and the proofs of life."""

    def __init__(self) -> None:
        self.times = 0
        self.since = lambda: 0
        self.at_ns = 0
        self.beats: list[int] = []
        self.entered, self.left = threading.Event(), threading.Event()
        self.linger_s = 0.0

    def on_edge(self) -> None:
        self.times += 1
        self.at_ns = self.since()
        self.entered.set()
        if self.linger_s:
            threading.Event().wait(self.linger_s)
        self.left.set()

    def on_alive(self, time_ns: int) -> None:
        self.beats.append(time_ns)


class Bench:
    """A fake probe, the driver on its port, and a stop."""

    def __init__(self) -> None:
        self.fake, self.stop, self.random = FakeProbe(), Stop(), random.Random(5)
        self.clock = self.fake.clock
        self.stop.since = self.clock.now_ns
        address = Address.parse(f"contact+serial://{self.fake.path}?baud={BAUD}")
        self.probe = open_probe("probe", address, Surroundings(self.clock, Path()))

    async def arm(self) -> None:
        await self.probe.arm(self.stop.on_edge, self.stop.on_alive)

    @asynccontextmanager
    async def living(self) -> AsyncIterator[None]:
        """The fake probe lives for the body's length; a failure in it fails the body."""
        async with asyncio.timeout(PATIENCE_S), asyncio.TaskGroup() as group:
            life = group.create_task(self.fake.live())
            try:
                yield
            finally:
                await self.probe.close()
                life.cancel()

    def run(self, script: Callable[[Bench], Awaitable[None]], *, connected: bool = True) -> None:
        async def whole() -> None:
            async with self.living():
                if connected:
                    await self.probe.connect()
                await script(self)

        asyncio.run(whole())


@pytest.fixture
def bench(monkeypatch):
    made, write = Bench(), SerialPort.write

    def counted(port, data):
        write(port, data)
        made.fake.sent += len(data)

    monkeypatch.setattr(SerialPort, "write", counted)
    yield made
    if made.fake._master >= 0:
        os.close(made.fake._master)
        os.close(made.fake._slave)
