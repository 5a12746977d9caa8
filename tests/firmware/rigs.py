"""A probe on a rig: its loop and its host are moved by hand. The firmware in simavr, and the simulated probe.

A rig takes the same voltages and the host's bytes at the same times from both, and gives what each sends, with the
times of the wire. Its host reads the lines as the driver does.
"""

from __future__ import annotations

import heapq
import itertools
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from drivers.contact_probe.lines import Line, LineError, encode, parse_line
from sims.kernel import Event as Due
from sims.probe._firmware import Crystal
from sims.probe._server import Probe
from tests.firmware.firmware_kit.firmware_bench import BYTE_CYCLES, CLOCK_HZ, Bench, Event

MS, US = 1_000_000, 1_000
CLOSED, OPEN, BROKEN = 40, 1650, 4950
BYTE_NS = 40_000
TICK_NS = 500
OVERFLOW_TICKS = 0x10000 // 8
"""Ticks of the firmware between two overflows of its 16-bit timer, which counts cycles."""
TIMES = ("heartbeat_at", "host_heard_at", "level_since")
"""Variables of the firmware that are ticks."""
DATA_SPACE = 0x800000
"""Where the linker's addresses of RAM begin."""


@dataclass(frozen=True, slots=True)
class Images:
    """Files that `make` has built."""

    bench: Path
    elf: Path
    selftest: Path

    def variable(self, name: str) -> int:
        """The address of one of the firmware's variables."""
        symbols = subprocess.run(["avr-nm", self.elf], capture_output=True, text=True, check=True).stdout.splitlines()
        (address,) = [line.split()[0] for line in symbols if line.split()[1:] in (["b", name], ["B", name])]
        return int(address, 16) - DATA_SPACE


@dataclass(frozen=True, slots=True)
class Sent:
    """A line of the probe: ns at its first start bit, and at the end of its last stop bit."""

    start_ns: int
    end_ns: int
    raw: bytes
    line: Line

    @property
    def kind(self) -> str:
        """`HB`"""
        return self.raw.split(b",", 1)[0].decode()

    @property
    def fields(self) -> list[str]:
        """Those after the tick, as text."""
        return self.raw.rsplit(b"*", 1)[0].decode().split(",")[3:]


class Rig:
    """What both rigs have. `sent`: every line so far; `refused`: what came and is no line; `changes`: of voltage."""

    ok_pin = False
    """Whether it has the hard-wired output."""

    def __init__(self) -> None:
        self.now = 0
        self.sent: list[Sent] = []
        self.refused: list[bytes] = []
        self.changes: list[int] = []
        self._next_seq = itertools.count()
        self._acknowledged = 0
        self._arrived = bytearray()
        self._begun_ns = 0

    def level(self, millivolts: int, at_ns: int | None = None) -> None:
        """The loop's voltage from now on, or from a time to come (in order)."""
        at_ns = self.now if at_ns is None else at_ns
        self.changes.append(at_ns)
        self._level(millivolts, at_ns)

    def _level(self, millivolts: int, at_ns: int) -> None:
        raise NotImplementedError

    def put(self, data: bytes) -> None:
        """The host's bytes, on the wire from now on."""
        raise NotImplementedError

    def _advance(self, end_ns: int) -> None:
        raise NotImplementedError

    def say(self, kind: str, seq: int | None = None) -> int:
        """A line of the host. Returns its number."""
        seq = next(self._next_seq) if seq is None else seq
        self.put(encode(kind, seq))
        return seq

    def wait(self, ms: float, *, host: bool = True) -> None:
        """Let time pass; a host that is there acknowledges each line within a millisecond."""
        end_ns = self.now + round(ms * MS)
        while self.now < end_ns:
            if host:
                self._acknowledge()
            step_ns = min(end_ns, self.now + MS)
            self._advance(step_ns)
            self.now = step_ns
        if host:
            self._acknowledge()

    def ask(self, kind: str, seq: int | None = None) -> list[str]:
        """A command and its answer's fields after `host_seq`. It is given within 20 ms."""
        before = len(self.sent)
        number = self.say(kind, seq)
        self.wait(20)
        answers = [s for s in self.sent[before:] if s.kind in {"RE", "ID", "SYNC"} and s.fields[0] == str(number)]
        assert len(answers) == 1, [s.raw for s in self.sent[before:]]
        return answers[0].fields[1:]

    def armed(self) -> Rig:
        """Awake, and armed with the loop open."""
        self.wait(60)
        assert self.ask("ARM") == ["OK"]
        return self

    def state(self) -> str:
        """As the next heartbeat has it."""
        before = len(self.lines("HB"))
        self.wait(60)
        return self.lines("HB")[before].fields[0]

    def lines(self, *kinds: str) -> list[Sent]:
        """Those of these kinds."""
        return [s for s in self.sent if s.kind in kinds]

    def once(self, *kinds: str) -> list[Sent]:
        """The same without repetitions."""
        first: dict[tuple[object, ...], Sent] = {}
        for sent in self.lines(*kinds):
            first.setdefault((sent.line.seq, sent.line.message), sent)
        return list(first.values())

    def edge_ns(self, tick: int) -> int:
        """The time on the rig at a count of the probe."""
        return tick * TICK_NS

    def bring_near_wrap(self) -> None:
        """The next lines have the numbers 65530 and on, and ticks that wrap 1 s from now."""
        raise NotImplementedError

    def close(self) -> None:
        """Nothing is to be let go."""

    def _acknowledge(self) -> None:
        for sent in self.sent[self._acknowledged :]:
            self.put(encode("ACK", sent.line.seq))
        self._acknowledged = len(self.sent)

    def _take(self, start_ns: int, end_ns: int, raw: bytes) -> None:
        try:
            self.sent.append(Sent(start_ns, end_ns, raw, parse_line(raw)))
        except LineError:
            self.refused.append(raw)


class FirmwareRig(Rig):
    """The firmware. `ppm`: by how much its clock is fast. `ok`: the output's changes, (ns, 0 or 1)."""

    ok_pin = True
    OK = "D4"
    EDGE_VECTOR = 10
    """TIMER1_CAPT."""

    def __init__(self, images: Images, millivolts: int = OPEN, ppm: float = 0.0) -> None:
        super().__init__()
        self._images = images
        self.bench = Bench(images.bench, images.elf)
        self.events: list[Event] = []
        self.ok: list[tuple[int, int]] = []
        self._hz = CLOCK_HZ * (1 + ppm * 1e-6)
        self.bench.host_bit(64 * (1 + ppm * 1e-6))
        self.bench.level(0, millivolts)

    def cycle(self, time_ns: int) -> int:
        """Of the chip's clock at a time of the rig."""
        return round(time_ns * self._hz / 1e9)

    def time_ns(self, cycle: int) -> int:
        """Of the rig at a cycle of the chip's clock."""
        return round(cycle * 1e9 / self._hz)

    def _level(self, millivolts: int, at_ns: int) -> None:
        self.bench.level(self.cycle(at_ns), millivolts)

    def put(self, data: bytes) -> None:
        """Over the bench's wire."""
        self.bench.receive(self.cycle(self.now), data)

    def reset(self, cause: str) -> None:
        """Now; its counts begin anew."""
        if cause == "WATCHDOG":
            self.bench.hang(self.cycle(self.now))
        else:
            self.bench.reset(self.cycle(self.now), cause)

    def bring_near_wrap(self) -> None:
        """By setting the program's clock, with the times that it keeps, and its outbox's next number."""
        now = int.from_bytes(self.bench.memory(self._images.variable("clock_overflows"), 4), "little")
        ahead = ((1 << 32) - 2_000_000) // OVERFLOW_TICKS - now
        for name, step in {"clock_overflows": 1, **dict.fromkeys(TIMES, OVERFLOW_TICKS)}.items():
            address = self._images.variable(name)
            value = int.from_bytes(self.bench.memory(address, 4), "little") + ahead * step
            self.bench.write(address, (value % (1 << 32)).to_bytes(4, "little"))
        self.bench.write(self._images.variable("next_seq"), (65530).to_bytes(2, "little"))

    def of_kind(self, kind: str) -> list[Event]:
        """The bench's events of this kind."""
        return [event for event in self.events if event.kind == kind]

    def close(self) -> None:
        """Switch it off."""
        self.bench.close()

    def _advance(self, end_ns: int) -> None:
        for event in self.bench.run(self.cycle(end_ns)):
            if event.kind == "tx":
                self._receive(event)
            else:
                self.events.append(event)
            if event.kind == "pin" and event.rest.startswith(self.OK):
                self.ok.append((self.time_ns(event.cycle), int(event.rest[-1])))
            if event.kind == "reset":
                self._arrived.clear()

    def _receive(self, event: Event) -> None:
        if not self._arrived:
            self._begun_ns = self.time_ns(event.cycle)
        self._arrived.append(int(event.rest, 16))
        if self._arrived[-1] == ord("\n"):
            self._take(self._begun_ns, self.time_ns(event.cycle + BYTE_CYCLES), bytes(self._arrived))
            self._arrived.clear()


class Queue:
    """The kernel's queue, without hosts that have to be waited for."""

    def __init__(self) -> None:
        self.now = 0
        self._queue: list[tuple[int, int, Due]] = []
        self._order = itertools.count()

    def at(self, time_ns: int, action: Callable[[], object]) -> Due:
        """As `Kernel.at`."""
        due = Due(action)
        heapq.heappush(self._queue, (max(time_ns, self.now), next(self._order), due))
        return due

    def after(self, delay_ns: int, action: Callable[[], object]) -> Due:
        """As `Kernel.after`."""
        return self.at(self.now + delay_ns, action)

    def run(self, end_ns: int) -> None:
        """Do what is due up to `end_ns`."""
        while self._queue and self._queue[0][0] <= end_ns:
            self.now, _, due = heapq.heappop(self._queue)
            due.run()
        self.now = end_ns


class Loop:
    """A circuit whose voltage is set by hand."""

    def __init__(self, millivolts: int) -> None:
        self.millivolts = millivolts
        self.on_change: Callable[[int], object] = lambda millivolts: None

    def set(self, millivolts: int) -> None:
        """At once."""
        self.millivolts = millivolts
        self.on_change(millivolts)


class SimulatorRig(Rig):
    """The simulated probe, with an exact crystal that counts from 0."""

    def __init__(self, millivolts: int = OPEN) -> None:
        super().__init__()
        self._queue = Queue()
        self._loop = Loop(millivolts)
        self.probe = Probe(self._queue, self._loop, 1, 250_000, 0, self._deliver, Crystal(0.0, 0, 0))

    def _level(self, millivolts: int, at_ns: int) -> None:
        self._queue.at(at_ns, lambda: self._loop.set(millivolts))

    def put(self, data: bytes) -> None:
        """Over the simulator's own wire."""
        self.probe.feed(data)

    def bring_near_wrap(self) -> None:
        """By a crystal that began to count earlier, and the outbox's next number."""
        crystal = Crystal(0.0, ((1 << 32) - 2_000_000), self.now)
        self.probe._crystal = self.probe._firmware._crystal = crystal
        self.probe._firmware._outbox._next_seq = 65530

    def reset(self, cause: str) -> None:
        """Now; its counts begin anew."""
        self._queue.run(self.now)
        self.probe.reset(cause)

    def _advance(self, end_ns: int) -> None:
        self._queue.run(end_ns)

    def _deliver(self, line: bytes, seq: int) -> None:
        self._take(self._queue.now - len(line) * BYTE_NS, self._queue.now, line)
