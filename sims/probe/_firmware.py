"""The probe's program, as a function of time, loop voltage and host lines, with the crystal that it counts by."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, StrEnum
from typing import Self, final

from sims.probe._lines import HostLine, Message, Outbox

TICK_HZ = 2_000_000
WORST_PPM = 50.0

PROTOCOL = 1
VERSION = "sim-1"

_MS = 1_000_000
HEARTBEAT_NS = 50 * _MS
CONFIRM_NS = 2 * _MS
OPEN_NS = 20 * _MS
STUCK_NS = 10_000 * _MS
HOST_SILENT_NS = 500 * _MS
STEADY_NS = 470_000
"""Four to five samples of the A/D converter: so long a level must stay before it counts, if no edge shows it."""

EDGE_MV = 1100
"""The comparator's threshold: an edge to closed goes below it, an edge to open above it."""

_REMEMBERED = 8
"""ARM and DISARM whose answers are kept for repetitions."""


@final
class Crystal:
    """Ticks as a function of T: `first` at `zero_ns`, then TICK_HZ · (1 + drift) a second."""

    def __init__(self, drift_ppm: float, first: int, zero_ns: int) -> None:
        self.drift_ppm = drift_ppm
        self._first = first
        self._zero_ns = zero_ns
        self._micro_hz = round(TICK_HZ * (1_000_000 + drift_ppm))

    @classmethod
    def from_seed(cls, seed: int) -> Self:
        """The crystal of this seed's probe, somewhere in its count at T = 0."""
        draw = random.Random(f"{seed} probe crystal")
        return cls(draw.uniform(-WORST_PPM, WORST_PPM), draw.randrange(2**32), 0)

    def restarted(self, now_ns: int) -> Crystal:
        """The same crystal, its count begun anew."""
        return Crystal(self.drift_ppm, 0, now_ns)

    def tick(self, now_ns: int) -> int:
        """The count at `now_ns`."""
        return (self._first + (now_ns - self._zero_ns) * self._micro_hz // 10**15) % 2**32


class State(StrEnum):
    """What the probe is doing."""

    DISARMED = "DISARMED"
    ARMED = "ARMED"
    TRIPPED = "TRIPPED"
    FAULT = "FAULT"


class Level(Enum):
    """What the loop's voltage means."""

    CLOSED = "closed"
    OPEN = "open and whole"
    BROKEN = "wire break"
    SENSELESS = "nothing"


_STANDING: dict[Level, set[str]] = {
    Level.OPEN: set(),
    Level.CLOSED: {"STUCK"},
    Level.BROKEN: {"WIRE"},
    Level.SENSELESS: {"RANGE"},
}
"""The faults whose cause is not gone at a level: DISARM does not leave them."""

_REFUSALS = {Level.CLOSED: "CLOSED", Level.BROKEN: "WIRE", Level.SENSELESS: "STATE"}


def level_of(millivolts: int) -> Level:
    """The meaning of a loop voltage, as the A/D converter measures it."""
    if millivolts < 500:
        return Level.CLOSED
    if 1400 <= millivolts <= 2500:
        return Level.OPEN
    return Level.BROKEN if millivolts > 4000 else Level.SENSELESS


@final
@dataclass(slots=True)
class Edge:
    """The first edge of a contact, on its way to confirmation."""

    tick: int
    confirm_at: int
    bounces: int = 0


@final
class Firmware:
    """One life of the probe, from a reset to the next.

    Call `update` at each change of the loop, at each line of the host, and at `wake_at` at the latest.
    """

    def __init__(self, name: str, serial: str, cause: str, crystal: Crystal, now: int, millivolts: int) -> None:
        self.state = State.DISARMED
        self.dropped = 0
        self._identity = (PROTOCOL, VERSION, name, serial, TICK_HZ, cause)
        self._crystal = crystal
        self._outbox = Outbox()
        self._millivolts = millivolts
        self._closed = millivolts < EDGE_MV
        self._level = level_of(millivolts)
        self._steady_at: int | None = None
        self._level_since = now
        self._level_tick = crystal.tick(now)
        self._touched = self._level is Level.CLOSED
        self._edge: Edge | None = None
        self._causes: set[str] = set()
        self._host_heard_at: int | None = None
        self._heartbeat_at = now + HEARTBEAT_NS
        self._answers: dict[HostLine, str] = {}
        self._outbox.post(now, "BOOT", PROTOCOL, cause)
        self._look_for_faults(now)

    def update(self, now: int, millivolts: int, lines: list[HostLine | None]) -> list[Message]:
        """The world at `now`: loop voltage, and the host's line (None: a line that made no sense).

        Returns the lines to send, in order. An edge is captured at `now`.
        """
        self._do_what_is_due(now)
        if millivolts != self._millivolts:
            self._change_voltage(now, millivolts)
        for line in lines:
            self._hear(now, line)
        return self._outbox.collect(now)

    @property
    def wake_at(self) -> int:
        """When `update` has to be called next, whatever happens."""
        due = [at for at, _ in self._timers()]
        repeat = self._outbox.wake_at
        return min(due if repeat is None else [*due, repeat])

    def _timers(self) -> list[tuple[int, Callable[[int], None]]]:
        timers: list[tuple[int, Callable[[int], None]]] = [(self._heartbeat_at, self._beat)]
        if self._edge is not None:
            timers.append((self._edge.confirm_at, self._confirm))
        if self._steady_at is not None:
            timers.append((self._steady_at, self._settle))
        if self._touched and self._level is Level.OPEN:
            timers.append((self._level_since + OPEN_NS, self._report_open))
        if self._level is Level.CLOSED and "STUCK" not in self._causes:
            timers.append((self._level_since + STUCK_NS, lambda now: self._fault(now, "STUCK")))
        if self.state is State.ARMED and self._host_heard_at is not None:
            timers.append((self._host_heard_at + HOST_SILENT_NS, lambda now: self._fault(now, "HOST")))
        return timers

    def _do_what_is_due(self, now: int) -> None:
        for at, action in self._timers():
            if at <= now:
                action(now)

    def _beat(self, now: int) -> None:
        self._heartbeat_at += HEARTBEAT_NS
        heard = self._host_heard_at is not None and now - self._host_heard_at < HOST_SILENT_NS
        self._outbox.post(now, "HB", self.state, self._millivolts, int(heard), once=True)

    def _confirm(self, now: int) -> None:
        if self._edge is not None:
            held = int(self._closed and self._level is not Level.SENSELESS)
            self._outbox.post(now, "CONF", self._edge.tick, held, self._edge.bounces)
            self._edge = None

    def _report_open(self, now: int) -> None:
        self._touched = False
        self._outbox.post(now, "OPEN", self._level_tick)

    def _change_voltage(self, now: int, millivolts: int) -> None:
        self._millivolts = millivolts
        if (millivolts < EDGE_MV) is not self._closed:
            self._closed = not self._closed
            self._pass_edge(now)
        self._steady_at = None if level_of(millivolts) is self._level else now + STEADY_NS

    def _settle(self, now: int) -> None:
        self._steady_at = None
        self._change_level(now, level_of(self._millivolts))
        self._look_for_faults(now)

    def _change_level(self, now: int, level: Level) -> None:
        self._level, self._level_since, self._level_tick = level, now, self._crystal.tick(now)
        self._touched |= level is Level.CLOSED

    def _pass_edge(self, now: int) -> None:
        self._change_level(now, Level.CLOSED if self._closed else Level.OPEN)
        self._touched = True  # also where it opens: it was closed before
        if self._edge is not None:
            self._edge.bounces += 1
        elif self._closed and self.state is State.ARMED:
            self.state = State.TRIPPED
            self._edge = Edge(self._level_tick, now + CONFIRM_NS)
            self._outbox.post(now, "EDGE", self._level_tick)

    def _look_for_faults(self, now: int) -> None:
        if self._level is Level.BROKEN:
            self._fault(now, "WIRE")
        elif self._level is Level.SENSELESS:
            self._fault(now, "RANGE")

    def _fault(self, now: int, cause: str) -> None:
        self.state = State.FAULT
        if cause not in self._causes:
            self._causes.add(cause)
            self._outbox.post(now, "FAULT", cause)

    def _hear(self, now: int, line: HostLine | None) -> None:
        if line is None:
            self.dropped += 1
            return
        self._host_heard_at = now
        if line.kind == "ACK":
            self._outbox.acknowledge(line.seq)
        elif line.kind == "HELLO":
            # a host that greets may be a new one, whose numbers begin anew
            self._answers.clear()
            self._outbox.post(now, "ID", line.seq, *self._identity)
        elif line.kind == "SYNC":
            # a repeated SYNC gets the tick of its repetition: an older one would lie before the host's own question
            self._outbox.post(now, "SYNC", line.seq, self._crystal.tick(now))
        elif line.kind in {"ARM", "DISARM"}:
            self._outbox.post(now, "RE", line.seq, self._once(now, line))
        else:
            self._outbox.post(now, "RE", line.seq, "UNKNOWN")

    def _once(self, now: int, line: HostLine) -> str:
        """The answer to ARM or DISARM, which a repetition gets without its being done again."""
        if line not in self._answers:
            self._answers[line] = self._arm(now) if line.kind == "ARM" else self._disarm()
            if len(self._answers) > _REMEMBERED:
                self._answers.pop(next(iter(self._answers)))
        return self._answers[line]

    def _arm(self, now: int) -> str:
        if self._level is Level.BROKEN:
            return "WIRE"  # whatever the state: this is what somebody can mend
        if self.state not in {State.DISARMED, State.ARMED}:
            return "STATE"
        if self._level is not Level.OPEN or now - self._level_since < OPEN_NS:
            return "CLOSED"
        self.state = State.ARMED
        return "OK"

    def _disarm(self) -> str:
        self._causes &= _STANDING[self._level]
        if self._causes:
            return _REFUSALS[self._level]
        self.state = State.DISARMED
        return "OK"
