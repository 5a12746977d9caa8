"""Each rule of docs/reference/probe-protocol.md, by the firmware in simavr and by the simulated probe alike."""

import re
from itertools import pairwise

import pytest

from drivers.contact_probe.lines import check_sum, encode
from tests.firmware.rigs import BROKEN, CLOSED, MS, OPEN, TICK_NS, US
from tests.firmware.rules import rule

SENSELESS = 3000
EDGE_WITHIN_NS = 2 * US
"""Of an edge's tick."""
LINE_WITHIN_NS = 2 * US
"""Of a line's own tick."""
SOON_NS = 700 * US
"""In which what is to be sent at once begins, on a free line."""
ARMED_SEARCH = pytest.mark.parametrize("hold_ms", [5, 100])


def framed(body: bytes) -> bytes:
    return b"%s*%04X\n" % (body, check_sum(body))


def starts_ms(lines):
    return [line.start_ns / MS for line in lines]


def last_word(probe):
    """When the last line of a host that then falls silent has arrived."""
    probe.say("ACK", 0)
    return probe.now + len(encode("ACK", 0)) * 40 * US


def free_ns(probe, time_ns):
    """When the line that is being sent at a time is over; that time if the probe sends nothing then."""
    return max([time_ns, *(s.end_ns for s in probe.sent if s.start_ns <= time_ns < s.end_ns)])


# Lines


@rule("A line has at most 120 characters and a CRC-16/CCITT-FALSE")
def test_every_line_of_a_touch_is_one_that_the_driver_reads(rig):
    probe = rig().armed()
    probe.ask("HELLO")
    probe.level(CLOSED)
    probe.wait(100)
    probe.level(OPEN)
    probe.wait(100)
    assert {s.kind for s in probe.sent} >= {"BOOT", "HB", "ID", "RE", "EDGE", "CONF", "OPEN"}
    assert not probe.refused
    assert max(len(s.raw) for s in probe.sent) <= 121


@rule("8N1 at 250 kbaud: a character takes 40 µs")
def test_characters_take_their_time(rig):
    probe = rig()
    probe.wait(300)
    assert len(probe.sent) > 5
    assert all(abs(s.end_ns - s.start_ns - len(s.raw) * 40 * US) <= 2 * US for s in probe.sent)


@rule("A `\\r` before the line's end is ignored")
def test_a_carriage_return_before_the_end_changes_nothing(rig):
    probe = rig()
    probe.wait(30)
    probe.put(encode("HELLO", 3).replace(b"\n", b"\r\n"))
    probe.wait(20)
    assert [s.fields[0] for s in probe.lines("ID")] == ["3"]


@rule("A host line with a wrong CRC, number or number of fields is dropped")
@pytest.mark.parametrize(
    "line",
    [
        b"ARM,1*0000\n",
        framed(b"ARM,1").lower(),
        framed(b"ARM,1").replace(b"*", b""),
        framed(b"ARM,1,"),
        framed(b"ARM,1,2"),
        framed(b"ARM"),
        framed(b"ARM,"),
        framed(b"ARM,01"),
        framed(b"ARM,65536"),
        framed(b"ARM,-1"),
        framed(b"ARM,1 "),
        framed(b" ARM,1"),
        framed(b"arm,1"),
        framed(b",1"),
        b"\n",
        b"*\n",
        b"*FFFF\n",
    ],
    ids=lambda line: line.decode().strip() or "empty",
)
def test_a_line_that_is_none_is_dropped_and_the_next_one_is_heard(rig, line):
    probe = rig()
    probe.wait(60)
    probe.put(line)
    probe.wait(30)
    assert not probe.lines("RE")
    assert probe.ask("ARM", 7) == ["OK"]


@rule("A well-formed line of an unknown type is answered `UNKNOWN`")
@pytest.mark.parametrize("body", [b"XYZZY,4", b"XYZZY,4,1,two,", b"A,4", b"ARMS,4", b"ACKNOWLEDGED,4"])
def test_an_unknown_type_is_answered(rig, body):
    probe = rig()
    probe.wait(60)
    probe.put(framed(body))
    probe.wait(20)
    assert [s.fields for s in probe.once("RE")] == [["4", "UNKNOWN"]]


@rule("A longer line than 120 characters is dropped whole")
def test_an_overlong_line_is_dropped_and_the_next_one_is_heard(rig):
    probe = rig()
    probe.wait(60)
    probe.put(framed(b"XYZZY,1," + b"1" * 104))  # 117 characters
    probe.wait(30)
    probe.put(framed(b"XYZZY,2," + b"2" * 108))  # 121
    probe.wait(30)
    probe.put(b"1" * 200 + framed(b"XYZZY,3"))
    probe.wait(30)
    assert [s.fields for s in probe.once("RE")] == [["1", "UNKNOWN"]]
    assert probe.ask("ARM", 7) == ["OK"]


@rule("`seq` counts the lines of a direction from 0; a repeated line keeps its number")
def test_lines_are_numbered_from_zero_without_a_gap(rig):
    probe = rig()
    probe.wait(120, host=False)
    probe.wait(400)
    probe.ask("HELLO")
    contents = {(s.line.seq, s.kind, *s.fields) for s in probe.sent}
    assert sorted(seq for seq, *_ in contents) == list(range(len(contents)))
    assert len(contents) > 10
    assert probe.sent[0].line.seq == 0


@rule("`seq` and `tick` go on from 0 after 65535 and 2^32 - 1")
def test_the_counts_wrap(rig):
    probe = rig().armed()
    probe.bring_near_wrap()
    before = len(probe.sent)
    probe.wait(1200)
    later = probe.sent[before + 1 :]
    seqs = [s.line.seq for s in later]
    assert 0 in seqs
    assert {(b - a) % 65536 for a, b in pairwise(seqs)} == {1}
    ticks = [s.line.tick for s in later]
    assert ticks[-1] < ticks[0]
    gaps_ns = [(b.start_ns - a.start_ns, (b.line.tick - a.line.tick) % 2**32 * TICK_NS) for a, b in pairwise(later)]
    assert max(abs(a - b) for a, b in gaps_ns) <= LINE_WITHIN_NS
    edge_ns = probe.now
    probe.level(CLOSED)
    probe.wait(20)
    (edge,) = probe.once("EDGE")
    before_line_ns = (edge.line.tick - edge.line.message.edge_tick) % 2**32 * TICK_NS
    assert abs(edge.start_ns - before_line_ns - edge_ns) <= EDGE_WITHIN_NS


@rule("`tick` is the 2 MHz count at the start of sending the line, repetitions too")
def test_a_line_bears_the_time_of_its_own_beginning(rig):
    probe = rig()
    probe.wait(200, host=False)
    probe.ask("HELLO")
    probe.wait(300)
    zero = probe.sent[0].start_ns - probe.sent[0].line.tick * TICK_NS
    late = [s.start_ns - zero - s.line.tick * TICK_NS for s in probe.sent]
    assert len(late) > 10
    assert max(map(abs, late)) <= LINE_WITHIN_NS


@rule("An unacknowledged line is repeated every 50 ms until it is acknowledged, with its number")
def test_a_line_is_repeated_until_it_is_acknowledged(rig):
    probe = rig()
    probe.wait(230, host=False)
    boots = probe.lines("BOOT")
    assert [s.line.seq for s in boots] == [0] * 5
    gaps = [b - a for a, b in pairwise(starts_ms(boots))]
    assert gaps == pytest.approx([50] * 4, abs=3)
    probe.say("ACK", 0)
    probe.wait(200, host=False)
    assert len(probe.lines("BOOT")) == 5


# What the probe sends


@rule("`BOOT` follows every reset, with its cause")
@pytest.mark.parametrize("cause", ["POWER", "EXTERNAL", "BROWNOUT", "WATCHDOG"])
def test_after_a_reset_the_probe_says_why(rig, cause):
    probe = rig()
    probe.wait(300)
    if cause != "POWER":
        probe.reset(cause)
        probe.wait(1000)
    boot = probe.once("BOOT")[-1]
    assert (boot.line.seq, boot.fields) == (0, ["1", cause])


@rule("`ID` answers `HELLO`")
def test_hello_is_answered_with_who_it_is(rig):
    probe = rig()
    probe.wait(60)
    protocol, version, name, serial, tick_hz, cause = probe.ask("HELLO")
    assert (protocol, tick_hz, cause) == ("1", "2000000", "POWER")
    assert "" not in (version, name, serial)


@rule("A new host (`HELLO`) may begin its numbers anew")
def test_the_numbers_of_a_new_host_are_no_repetitions(rig):
    probe = rig()
    probe.wait(60)
    probe.ask("HELLO", 0)
    assert probe.ask("ARM", 1) == ["OK"]
    assert probe.ask("DISARM", 2) == ["OK"]
    probe.ask("HELLO", 0)
    assert probe.ask("ARM", 1) == ["OK"]
    assert probe.state() == "ARMED"


@rule("`HB` every 50 ms: state, loop voltage within 10 mV, whether the host is heard; never repeated")
def test_heartbeats(rig):
    probe = rig()
    probe.wait(600)
    beats = probe.lines("HB")
    assert 11 <= len(beats) <= 12
    assert len({s.line.seq for s in beats}) == len(beats)
    # a line that is being sent delays a heartbeat by its length, and does not shift the next
    late = [start - beats[-1].start_ns / MS + 50 * (len(beats) - 1 - i) for i, start in enumerate(starts_ms(beats))]
    assert late == pytest.approx([0] * len(beats), abs=3)
    assert {(s.fields[0], s.fields[2]) for s in beats} == {("DISARMED", "1")}
    assert all(abs(int(s.fields[1]) - OPEN) <= 10 for s in beats)


@rule("After 500 ms without a valid line of the host, `host_ok` is 0")
def test_a_silent_host_is_noticed_by_the_first_heartbeat_after_half_a_second(rig):
    probe = rig()
    probe.wait(200)
    since_ns = last_word(probe)
    probe.wait(700, host=False)
    told = [(s.start_ns - since_ns, s.fields[2]) for s in probe.lines("HB") if s.start_ns > since_ns]
    assert {ok for after, ok in told if after < 499 * MS} == {"1"}
    assert {ok for after, ok in told if after > 502 * MS} == {"0"}
    probe.put(b"ARM,5*0000\n")  # no valid line
    probe.wait(60, host=False)
    assert probe.lines("HB")[-1].fields[2] == "0"
    probe.say("HELLO")
    probe.wait(60, host=False)
    assert probe.lines("HB")[-1].fields[2] == "1"


@rule("`EDGE` at once at the first edge while armed; its tick is that of the edge")
@pytest.mark.parametrize("after_us", [0, 137.3, 4096.0, 10_011.7])
def test_an_edge_while_armed_is_told_at_once_with_its_time(rig, after_us):
    probe = rig().armed()
    zero_ns = probe.sent[0].start_ns - probe.sent[0].line.tick * TICK_NS
    edge_ns = probe.now + round(after_us * US)
    probe.level(CLOSED, edge_ns)
    probe.wait(50)
    (edge,) = probe.once("EDGE")
    told_ns = edge.line.message.edge_tick * TICK_NS + zero_ns
    assert abs(told_ns - edge_ns) <= EDGE_WITHIN_NS
    assert edge.start_ns < free_ns(probe, edge_ns) + SOON_NS
    assert probe.state() == "TRIPPED"


@rule("An edge while not armed is not told as `EDGE`")
def test_an_edge_while_disarmed_is_no_contact(rig):
    probe = rig()
    probe.wait(60)
    probe.level(CLOSED)
    probe.wait(50)
    assert not probe.lines("EDGE", "CONF")
    assert probe.state() == "DISARMED"


@rule("`CONF` 2 ms after the edge: whether the level held, and the number of further edges")
@pytest.mark.parametrize(
    ("further_us", "expected"),
    [
        ((), ("1", "0")),
        ((100, 300), ("1", "2")),
        ((500,), ("0", "1")),
        ((50, 90, 700, 1500), ("1", "4")),
        ((1950,), ("0", "1")),
        ((2050,), ("1", "0")),
        ((2050, 2300), ("1", "0")),
    ],
)
def test_a_contact_is_confirmed_after_two_milliseconds(rig, further_us, expected):
    probe = rig().armed()
    edge_ns = probe.now
    for number, after_us in enumerate((0, *further_us)):
        probe.level(OPEN if number % 2 else CLOSED, edge_ns + after_us * US)
    probe.wait(40)
    (edge,), (confirmation,) = probe.once("EDGE"), probe.once("CONF")
    assert confirmation.fields == [edge.fields[0], *expected]
    due_ns = edge_ns + 2 * MS
    assert due_ns <= confirmation.start_ns <= free_ns(probe, due_ns) + SOON_NS


@rule("`OPEN` when the loop has been open for 20 ms after a contact, with the time of its opening")
@ARMED_SEARCH
def test_the_end_of_a_contact_is_told_after_twenty_milliseconds(rig, hold_ms):
    probe = rig().armed()
    zero_ns = probe.sent[0].start_ns - probe.sent[0].line.tick * TICK_NS
    probe.level(CLOSED)
    probe.wait(hold_ms)
    opened_ns = probe.now
    probe.level(OPEN)
    probe.wait(15)
    assert not probe.lines("OPEN")
    probe.wait(30)
    (line,) = probe.once("OPEN")
    assert abs(line.line.message.edge_tick * TICK_NS + zero_ns - opened_ns) <= EDGE_WITHIN_NS
    assert 20 * MS <= line.start_ns - opened_ns <= 20 * MS + 4 * MS  # behind a line of up to 3 ms


@rule("An opening above the comparator's threshold is timed by its edge, also from an undefined voltage")
def test_the_opening_from_an_undefined_voltage_has_the_time_of_its_edge(rig):
    probe = rig()
    probe.wait(60)
    zero_ns = probe.sent[0].start_ns - probe.sent[0].line.tick * TICK_NS
    for number in range(6):
        probe.level(800)
        probe.wait(20 + number * 0.017)
        opened_ns = probe.now
        probe.level(OPEN)
        probe.wait(40)
        line = probe.once("OPEN")[number]
        assert abs(line.line.message.edge_tick * TICK_NS + zero_ns - opened_ns) <= EDGE_WITHIN_NS


@rule("A contact that opens for less than 20 ms is still one")
def test_a_short_opening_is_not_told(rig):
    probe = rig().armed()
    probe.level(CLOSED)
    probe.wait(50)
    probe.level(OPEN)
    probe.wait(15)
    probe.level(CLOSED)
    probe.wait(100)
    assert not probe.lines("OPEN")
    assert len(probe.once("EDGE")) == 1


@rule("`FAULT WIRE` within 5 ms, in any state")
@pytest.mark.parametrize("state", ["DISARMED", "ARMED", "TRIPPED"])
@pytest.mark.parametrize("busy", [False, True], ids=["line idle", "line busy"])
def test_a_broken_wire_is_told_within_five_milliseconds(rig, state, busy):
    probe = rig()
    probe.wait(60)
    if state != "DISARMED":
        assert probe.ask("ARM") == ["OK"]
    if state == "TRIPPED":
        probe.level(CLOSED)
        probe.wait(30)
    if busy:
        probe.put(encode("HELLO", 40))  # its answer is the longest line
        probe.wait(1)
    broken_ns = probe.now
    probe.level(BROKEN)
    probe.wait(10)
    (fault,) = probe.once("FAULT")
    assert fault.fields == ["WIRE"]
    assert fault.start_ns - broken_ns <= 5 * MS
    assert not [s for s in probe.lines("EDGE") if s.start_ns > broken_ns]
    assert probe.state() == "FAULT"


@rule("`FAULT STUCK` when the loop is closed for over 10 s")
def test_a_loop_that_stays_closed_is_a_fault(rig):
    probe = rig().armed()
    closed_ns = probe.now
    probe.level(CLOSED)
    probe.wait(9_990)
    assert not probe.lines("FAULT")
    probe.wait(60)
    (fault,) = probe.once("FAULT")
    assert fault.fields == ["STUCK"]
    assert 10_000 * MS <= fault.start_ns - closed_ns <= 10_010 * MS
    assert probe.ask("DISARM") == ["CLOSED"]
    probe.level(OPEN)
    probe.wait(30)
    assert probe.ask("DISARM") == ["OK"]


@rule("`FAULT RANGE` for an undefined voltage")
@pytest.mark.parametrize("millivolts", [800, 1250, SENSELESS, 3900])
def test_an_undefined_voltage_is_a_fault(rig, millivolts):
    probe = rig()
    probe.wait(60)
    probe.level(millivolts)
    probe.wait(30)
    assert [s.fields for s in probe.once("FAULT")] == [["RANGE"]]
    assert probe.ask("ARM") == ["STATE"]
    assert probe.ask("DISARM") == ["STATE"]
    probe.level(OPEN)
    probe.wait(30)
    assert probe.ask("DISARM") == ["OK"]


@rule("`FAULT HOST` when the host is silent for 500 ms while armed")
def test_a_silent_host_while_armed_is_a_fault(rig):
    probe = rig().armed()
    probe.wait(300)
    since_ns = last_word(probe)
    probe.wait(499, host=False)
    assert not probe.lines("FAULT")
    probe.wait(50, host=False)
    (fault,) = probe.once("FAULT")
    assert fault.fields == ["HOST"]
    assert 499 * MS <= fault.start_ns - since_ns <= 510 * MS
    assert probe.ask("DISARM") == ["OK"]


@rule("`SYNC` is answered with the count at which it was received, a repetition with its own")
def test_a_sync_is_answered_with_the_time_of_its_arrival(rig):
    probe = rig()
    probe.wait(60)
    zero_ns = probe.sent[0].start_ns - probe.sent[0].line.tick * TICK_NS
    for _ in range(2):
        said_ns = probe.now
        (tick,) = probe.ask("SYNC", 9)
        received_ns = int(tick) * TICK_NS + zero_ns - said_ns
        wire_ns = len(encode("SYNC", 9)) * 40 * US
        assert wire_ns - 4 * US <= received_ns <= wire_ns + SOON_NS


# ARM and DISARM


@rule("`ARM` is answered `OK` with the loop open, also when armed")
def test_arm_and_arm_again(rig):
    probe = rig().armed()
    assert probe.ask("ARM") == ["OK"]
    assert probe.state() == "ARMED"
    assert probe.ask("DISARM") == ["OK"]
    assert probe.state() == "DISARMED"


@rule("`ARM` is answered `CLOSED` with the loop closed, or not open for 20 ms yet")
def test_a_closed_loop_is_not_armed(rig):
    probe = rig()
    probe.wait(60)
    probe.level(CLOSED)
    probe.wait(30)
    assert probe.ask("ARM") == ["CLOSED"]
    probe.level(OPEN)
    probe.wait(10)
    probe.say("ARM", 70)
    probe.wait(5)
    probe.wait(20)
    assert [s.fields for s in probe.once("RE")][-1] == ["70", "CLOSED"]
    assert probe.ask("ARM") == ["OK"]


@rule("`ARM` is answered `WIRE` with the loop broken, in any state")
def test_a_broken_loop_is_not_armed(rig):
    probe = rig()
    probe.wait(60)
    probe.level(BROKEN)
    probe.wait(30)
    assert probe.ask("ARM") == ["WIRE"]
    assert probe.ask("DISARM") == ["WIRE"]
    probe.level(OPEN)
    probe.wait(30)
    assert probe.ask("DISARM") == ["OK"]
    assert probe.ask("ARM") == ["OK"]


@rule("`ARM` is answered `STATE` after a contact until `DISARM`")
def test_after_a_contact_arm_needs_disarm(rig):
    probe = rig().armed()
    probe.level(CLOSED)
    probe.wait(30)
    probe.level(OPEN)
    probe.wait(60)
    assert probe.ask("ARM") == ["STATE"]
    assert probe.ask("DISARM") == ["OK"]
    assert probe.ask("ARM") == ["OK"]


@rule("`DISARM` with the loop closed after a contact is `OK`")
def test_disarm_while_touching(rig):
    probe = rig().armed()
    probe.level(CLOSED)
    probe.wait(30)
    assert probe.ask("DISARM") == ["OK"]
    assert probe.state() == "DISARMED"


@rule("A repeated command is executed once and answered each time")
def test_a_repeated_command_is_not_done_again(rig):
    probe = rig()
    probe.wait(60)
    assert probe.ask("ARM", 5) == ["OK"]
    probe.level(CLOSED)
    probe.wait(30)
    assert probe.ask("ARM", 5) == ["OK"]
    assert probe.state() == "TRIPPED"
    assert probe.ask("DISARM", 6) == ["OK"]
    assert probe.ask("ARM", 5) == ["OK"]
    assert probe.state() == "DISARMED"


# Resets


@rule("After a reset while armed the probe is disarmed; numbers begin anew")
@pytest.mark.parametrize("cause", ["EXTERNAL", "BROWNOUT", "WATCHDOG"])
def test_a_reset_while_armed_voids_the_search(rig, cause):
    probe = rig().armed()
    probe.reset(cause)
    probe.wait(600)
    before = [s.kind for s in probe.sent].index("BOOT", 1)
    assert [s.fields for s in probe.sent[before : before + 1]] == [["1", cause]]
    probe.level(CLOSED)
    probe.wait(50)
    assert not probe.lines("EDGE")
    beat = probe.lines("HB")[-1]
    assert beat.fields[0] == "DISARMED"
    assert re.fullmatch(rb"HB,\d+,\d+,DISARMED,\d+,1\*[0-9A-F]{4}\n", beat.raw)


# Voltages


@rule("Under 500 mV is closed, 1400 to 2500 mV is open, over 4000 mV is broken, anything else is `RANGE`")
@pytest.mark.parametrize(
    ("millivolts", "expected"),
    [(0, "CLOSED"), (480, "CLOSED"), (520, "STATE"), (1380, "STATE"), (1420, "OK"), (2480, "OK"), (2520, "STATE"),
     (3980, "STATE"), (4020, "WIRE"), (5000, "WIRE")],
)  # fmt: skip
def test_what_a_voltage_means_for_arm(rig, millivolts, expected):
    probe = rig(millivolts=millivolts)
    probe.wait(100)
    assert probe.ask("ARM") == [expected]
