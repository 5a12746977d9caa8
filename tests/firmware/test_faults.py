"""What goes wrong on a real loop and line: the contact is told once and in time, and none is invented."""

import random
from itertools import pairwise

import pytest

from drivers.contact_probe.lines import check_sum, encode
from tests.firmware.rigs import BROKEN, BYTE_NS, CLOSED, MS, OPEN, TICK_NS, US
from tests.firmware.rules import rule

STOP_WITHIN_NS = 10 * US
SHORT_US = 10
"""The firmware may miss two edges less than this apart: its interrupt turns the capture's direction."""


def zero_ns(probe):
    """The rig's time at the count 0."""
    return probe.sent[0].start_ns - probe.sent[0].line.tick * TICK_NS


def bouncing(probe, bounces, seed):
    """A contact that opens and closes again so many times within 2 ms. Returns the time of its first edge."""
    draw = random.Random(seed)
    slots = range(15, 1980, 15)
    times = sorted(draw.sample(slots, 2 * bounces))
    first_ns = probe.now + draw.randrange(MS)
    probe.level(CLOSED, first_ns)
    for number, after_us in enumerate(times):
        probe.level(CLOSED if number % 2 else OPEN, first_ns + after_us * US)
    return first_ns


@rule("A contact that bounces is one contact, at its first edge; every further edge is counted")
@pytest.mark.parametrize("bounces", [1, 2, 5, 20, 50])
def test_bounces_give_one_contact_at_the_first_edge(rig, bounces):
    probe = rig().armed()
    first_ns = bouncing(probe, bounces, bounces)
    probe.wait(100)
    (edge,), (confirmation,) = probe.once("EDGE"), probe.once("CONF")
    assert abs(edge.line.message.edge_tick * TICK_NS + zero_ns(probe) - first_ns) <= 2 * US
    assert confirmation.fields == [edge.fields[0], "1", str(2 * bounces)]
    assert not probe.lines("OPEN", "FAULT")
    assert probe.state() == "TRIPPED"


@rule("Bounces of a few microseconds are one contact, too, though not all of them are counted")
@pytest.mark.parametrize("seed", range(20))
def test_short_bounces_give_one_contact(rig, seed):
    probe = rig().armed()
    draw = random.Random(seed)
    first_ns = at_ns = probe.now + draw.randrange(MS)
    probe.level(CLOSED, at_ns)
    for _ in range(draw.randrange(1, 40)):
        for millivolts in (OPEN, CLOSED):
            at_ns += draw.randrange(700, 9000)
            probe.level(millivolts, at_ns)
    probe.wait(100)
    (edge,), (confirmation,) = probe.once("EDGE"), probe.once("CONF")
    assert abs(edge.line.message.edge_tick * TICK_NS + zero_ns(probe) - first_ns) <= 2 * US
    assert confirmation.fields[1] == "1"
    assert not probe.lines("OPEN", "FAULT")
    assert probe.state() == "TRIPPED"


@rule("The stop output is on while the loop is open for 20 ms and the host is heard")
def test_the_output_is_on_only_with_open_loop_and_host(firmware):
    probe = firmware()
    probe.wait(100, host=False)
    assert probe.ok == []
    probe.wait(100)
    assert [on for _, on in probe.ok] == [1]


@rule("The stop output is off within 10 µs of the edge, armed or not")
@pytest.mark.parametrize("arm", [True, False])
def test_a_contact_drops_the_output_within_ten_microseconds(firmware, arm):
    probe = firmware()
    probe.wait(100)
    if arm:
        probe.ask("ARM")
    draw = random.Random(1)
    late = []
    for _ in range(30):
        probe.wait(draw.randrange(100, 3000) / 100)
        edge_ns = probe.now
        probe.level(CLOSED)
        probe.wait(5)
        off_ns, on = probe.ok[-1]
        assert not on
        late.append(off_ns - edge_ns)
        probe.level(OPEN)
        probe.wait(40)
        assert probe.ok[-1][1] == 1
        if arm:
            assert probe.ask("DISARM") == ["OK"]
            assert probe.ask("ARM") == ["OK"]
    assert max(late) <= STOP_WITHIN_NS


@rule("The stop output is off within 5 ms of a wire break")
def test_a_wire_break_drops_the_output(firmware):
    probe = firmware()
    probe.wait(100)
    broken_ns = probe.now
    probe.level(BROKEN)
    probe.wait(10)
    off_ns, on = probe.ok[-1]
    assert not on
    assert off_ns - broken_ns <= 5 * MS


@rule("The stop output is off 500 ms after the last valid line of the host, and on again with the next")
def test_a_silent_host_drops_the_output(firmware):
    probe = firmware()
    probe.wait(200)
    probe.say("ACK", 0)
    heard_ns = probe.now + len(encode("ACK", 0)) * BYTE_NS
    probe.wait(700, host=False)
    off_ns, on = probe.ok[-1]
    assert not on
    assert 0 <= off_ns - heard_ns - 500 * MS <= MS
    probe.put(b"ACK,0*0000\n")
    probe.wait(20, host=False)
    assert not probe.ok[-1][1]
    probe.say("ACK", 0)
    probe.wait(20, host=False)
    assert probe.ok[-1][1]


@rule("The stop output is off in a reset")
@pytest.mark.parametrize("cause", ["POWER", "EXTERNAL", "BROWNOUT"])
def test_a_reset_drops_the_output_at_once(firmware, cause):
    probe = firmware()
    probe.armed()
    probe.wait(30)
    reset_ns = probe.now
    probe.reset(cause)
    probe.wait(10, host=False)
    off_ns, on = probe.ok[-1]
    assert not on
    assert off_ns - reset_ns <= 2 * US


@rule("The watchdog drops the stop output of a program that hangs, within 100 ms")
def test_a_hanging_program_drops_the_output(firmware):
    probe = firmware()
    probe.armed()
    hang_ns = probe.now
    probe.reset("WATCHDOG")
    probe.wait(200, host=False)
    off_ns, on = probe.ok[-1]
    assert not on
    assert off_ns - hang_ns <= 100 * MS


@rule("A clock that is 300 ppm off changes nothing but the count")
@pytest.mark.parametrize("ppm", [-300, 300])
def test_a_clock_that_is_off_gives_contacts_at_their_times(firmware, ppm):
    probe = firmware(ppm=ppm).armed()
    for _ in range(20):
        edge_ns = probe.now
        probe.level(CLOSED)
        probe.wait(30)
        line = probe.once("EDGE")[-1]
        before_line_ns = (line.line.tick - line.line.message.edge_tick) * TICK_NS / (1 + ppm * 1e-6)
        assert abs(line.start_ns - before_line_ns - edge_ns) <= 2 * US
        probe.level(OPEN)
        probe.wait(60)
        assert probe.ask("DISARM") == ["OK"]
        assert probe.ask("ARM") == ["OK"]
    assert not probe.refused


@rule("A host whose baud rate is 2 % off is heard; one that is 10 % off is not, and does no harm")
@pytest.mark.parametrize(("bit_cycles", "heard"), [(62.8, 10), (65.2, 10), (57.6, 0), (70.4, 0)])
def test_a_host_whose_baud_rate_is_off(firmware, bit_cycles, heard):
    probe = firmware().armed()
    probe.bench.host_bit(bit_cycles)
    probe.put(b"".join(encode("SYNC", n) for n in range(10)))
    probe.wait(60, host=False)
    assert len(probe.once("SYNC")) == heard
    probe.bench.host_bit(64)
    probe.put(b"\n")
    probe.wait(60)
    assert probe.state() == "ARMED"


@rule("No byte is lost at full rate, whatever else happens")
def test_the_line_at_full_rate_is_heard_whole(firmware):
    probe = firmware().armed()
    for number in range(40):
        probe.put(encode("ACK", 50_000) * 30 + encode("SYNC", number))
        probe.level(CLOSED if number % 2 else OPEN)
        probe.wait(30)
    assert not probe.of_kind("overrun")
    assert {s.fields[0] for s in probe.lines("SYNC")} == {str(n) for n in range(40)}


@rule("An overrun loses lines, not the probe")
def test_an_overrun_loses_lines_and_nothing_else(firmware):
    probe = firmware().armed()
    probe.bench.host_bit(2)  # faster than the program can read
    probe.put(encode("SYNC", 1) * 300)
    probe.wait(30)
    assert probe.of_kind("overrun")
    probe.bench.host_bit(64)
    probe.put(b"\n")
    probe.wait(10)
    assert probe.ask("ARM") == ["OK"]
    assert not probe.lines("EDGE", "FAULT")
    assert [s.fields for s in probe.lines("BOOT")] == [["1", "POWER"]]


COMMANDS = [encode(kind, 12345) for kind in ("ACK", "HELLO", "ARM", "DISARM", "SYNC")]


@rule("Every truncated line is dropped")
@pytest.mark.parametrize(
    "line", [*COMMANDS, b"XYZZY,1,2*%04X\n" % check_sum(b"XYZZY,1,2")], ids=lambda line: line[:5].decode()
)
def test_a_truncated_line_is_dropped(rig, line):
    probe = rig().armed()
    for length in range(1, len(line) - 1):
        for cut in (line[:length] + b"\n", line[length:]):
            probe.put(cut)
            probe.wait(4)
    assert len(probe.once("RE", "ID", "SYNC")) == 1  # that of ARM before
    assert probe.state() == "ARMED"


@rule("Random bytes are no commands: it answers afterwards, and tells no contact that was none")
@pytest.mark.parametrize("count", [3_000, pytest.param(1_000_000, marks=pytest.mark.long)])
def test_random_bytes_do_nothing(firmware, count):
    probe = firmware().armed()
    draw = random.Random(count)
    pieces = [encode(kind, 7)[:size] for kind in ("ARM", "SYNC", "HELLO", "ACK") for size in (2, 6, 9)]
    sent = 0
    while sent < count:
        data = draw.randbytes(400) if draw.random() < 0.8 else b"".join(draw.choices([*pieces, b"\n", b"*"], k=60))
        data += b"\n"  # so that the host's next acknowledgement is heard
        sent += len(data)
        probe.put(data)
        probe.wait(len(data) * 0.041)
    assert probe.ask("ARM") == ["OK"]
    assert not probe.lines("EDGE", "CONF", "OPEN", "FAULT")
    assert len(probe.lines("BOOT")) == 1
    assert all(b >= a for a, b in pairwise(s.line.tick for s in probe.sent))
    probe.level(CLOSED)
    probe.wait(20)
    assert len(probe.once("EDGE")) == 1


@rule("The comparator's threshold by the data sheet, 1.0 to 1.2 V with its offset, is between closed and open")
@pytest.mark.parametrize("bandgap_mv", [960, 1240])
def test_a_comparator_at_the_limits_of_its_threshold_tells_contact_from_open(firmware, bandgap_mv):
    probe = firmware()
    probe.bench.bandgap(bandgap_mv)
    probe.wait(100)
    assert probe.ask("ARM") == ["OK"]
    probe.level(490)
    probe.wait(20)
    assert [s.fields[1] for s in probe.once("CONF")] == ["1"]
    probe.level(1410)
    probe.wait(40)
    assert len(probe.once("OPEN")) == 1
    assert not probe.lines("FAULT")
