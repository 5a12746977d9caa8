"""How late the edge is seen, over edges at every phase of whatever else the firmware does: the figures of README.md."""

import random
from dataclasses import dataclass

import pytest

from drivers.contact_probe.lines import encode
from tests.firmware.rigs import CLOSED, OPEN, TICK_NS

CYCLE_US = 1 / 16
STOP_WITHIN_US = 10.0
COMPARATOR_US = 0.5
CAPTURED_CYCLES = 8 + 3 + 4
"""From the loop's edge to the capture's flag: comparator (500 ns), synchroniser and edge detector, noise canceller."""
JUMP_CYCLES = 3
"""Of the vector, after the entry that the bench reports."""


@dataclass(frozen=True)
class Edge:
    """Of one contact while armed, in µs after it: stop output off, first instruction; the error of `edge_tick`."""

    stop_us: float
    entry_us: float
    tick_us: float


def edges(probe, count, *, busy=True, place=None):
    """Contacts at random cycles; `busy`: while the host's line and the probe's are never idle.

    `place(number, earliest, zero)`: the cycle of each, after `earliest`; the timer counts from `zero`.
    """
    probe.wait(60)
    probe.bench.watch(probe.EDGE_VECTOR)
    zero = probe.bench.timer_base() % 0x10000  # cycles from reset to the start of the count
    draw = random.Random(count)
    seq = iter(range(1, 60_000))
    found = []
    for number in range(count):
        assert probe.ask("ARM", next(seq)) == ["OK"]
        if busy:
            for _ in range(4):
                probe.put(encode("SYNC", next(seq)) + encode("ACK", 59_999) * 12)
        cycle = probe.cycle(probe.now) + draw.randrange(32_000, 192_000)
        if place:
            cycle = place(number, cycle, zero)
        before = len(probe.events)
        probe.bench.level(cycle, CLOSED)
        probe.wait(20)
        later = [event for event in probe.events[before:] if event.cycle >= cycle]
        stop = next(event.cycle for event in later if event.kind == "pin" and event.rest == f"{probe.OK} 0")
        entry = next(event.cycle for event in later if event.kind == "irq")
        tick = probe.once("EDGE")[-1].line.message.edge_tick
        late_us = tick * TICK_NS / 1e3 - (cycle - zero) * CYCLE_US
        found.append(Edge((stop - cycle) * CYCLE_US, (entry + JUMP_CYCLES - cycle) * CYCLE_US, late_us))
        probe.level(OPEN)
        probe.wait(30)
        assert probe.ask("DISARM", next(seq)) == ["OK"]
        del probe.sent[:-30]
        probe._acknowledged = len(probe.sent)
        del probe.events[:]
    return found


@pytest.mark.parametrize("count", [40, pytest.param(1500, marks=pytest.mark.long)])
def test_the_stop_output_is_off_in_time_whatever_else_happens(firmware, count):
    found = edges(firmware(), count)
    stops = sorted(edge.stop_us for edge in found)
    latencies = sorted(edge.entry_us - CAPTURED_CYCLES * CYCLE_US for edge in found)
    ticks = [edge.tick_us for edge in found]
    late = f"median {stops[count // 2]:.2f}, 99 % {stops[count * 99 // 100]:.2f}, worst {stops[-1]:.2f}"
    print(f"{count} edges; stop output: {late} µs")
    print(f"interrupt latency: median {latencies[count // 2]:.2f} µs, worst {latencies[-1]:.2f}")
    print(f"edge_tick: {min(ticks):+.3f} … {max(ticks):+.3f} µs")
    assert stops[-1] <= STOP_WITHIN_US


@pytest.mark.parametrize("count", [40, pytest.param(1000, marks=pytest.mark.long)])
def test_the_edge_is_timed_to_a_tick(firmware, count):
    """The comparator is 0.5 µs late, which the firmware does not know; the count is cut to whole ticks of 0.5 µs."""
    errors = [edge.tick_us for edge in edges(firmware(), count, busy=False)]
    print(f"edge_tick: {min(errors):+.4f} … {max(errors):+.4f} µs, mean {sum(errors) / count:+.4f}")
    assert max(errors) <= COMPARATOR_US
    assert min(errors) > COMPARATOR_US - TICK_NS / 1e3


def test_an_edge_at_the_timers_overflow_is_timed_right(firmware):
    """The count's 16 bits overflow every 4.096 ms; the capture's interrupt may come before or after the overflow's."""
    offsets = range(-60, 61, 3)

    def place(number, earliest, zero):
        return earliest + (zero - earliest) % 0x10000 + offsets[number]

    errors = [edge.tick_us for edge in edges(firmware(), len(offsets), busy=False, place=place)]
    assert max(errors) <= COMPARATOR_US
    assert min(errors) > COMPARATOR_US - TICK_NS / 1e3
