"""The probe's states, answers and repetitions, without a wire: docs/reference/probe-protocol.md, line by line."""

import pytest

from sims.probe._firmware import Crystal, Firmware, State, level_of
from sims.probe._lines import HostLine

MS = 1_000_000
CLOSED, OPEN, BROKEN = 40, 1650, 4900


class Bench:
    """A probe on a bench: its voltage is set by hand, its host types what the test says. 2 ticks a microsecond."""

    def __init__(self, millivolts=OPEN, cause="POWER"):
        self.now, self.millivolts, self.said, self._seq = 0, millivolts, [], 0
        self.firmware = Firmware("a SIM probe", "SIM-1", cause, Crystal(0.0, 0, 0), 0, millivolts)
        self._update([])

    def _update(self, lines):
        self.said += [(self.now // MS, m) for m in self.firmware.update(self.now, self.millivolts, lines)]

    def wait(self, ms, *, host=True):
        """Let time pass; a host that is there acknowledges everything at once."""
        end = self.now + round(ms * MS)
        if host:
            self._acknowledge(0)
        while self.firmware.wake_at <= end:
            before, self.now = len(self.said), self.firmware.wake_at
            self._update([])
            if host:
                self._acknowledge(before)
        self.now = end

    def volts(self, millivolts):
        self.millivolts = millivolts
        self._update([])

    def hear(self, kind, seq=None):
        """A line of the host; returns what the probe says to it."""
        if seq is None:
            seq, self._seq = self._seq, self._seq + 1
        before = len(self.said)
        self._update([HostLine(kind, seq)])
        return [m for _, m in self.said[before:]]

    def ask(self, kind, seq=None):
        """The code with which a command is answered."""
        (answer,) = self.hear(kind, seq)
        assert answer.kind == "RE"
        return answer.fields[1]

    def armed(self):
        self.wait(30)
        assert self.ask("ARM") == "OK"
        return self

    def lines(self, *kinds):
        return [m for _, m in self.said if m.kind in kinds]

    def _acknowledge(self, since):
        for _, message in self.said[since:]:
            self._update([HostLine("ACK", message.seq)])


@pytest.fixture
def bench():
    return Bench()


@pytest.fixture
def armed():
    return Bench().armed()


def test_a_probe_says_after_a_reset_why_it_was_reset():
    (boot,) = Bench(cause="WATCHDOG").lines("BOOT")
    assert boot.seq == 0
    assert boot.fields == (1, "WATCHDOG")


def test_hello_is_answered_with_who_it_is_and_that_it_is_simulated(bench):
    (identity,) = bench.hear("HELLO", 5)
    host_seq, protocol, _, name, serial, tick_hz, cause = identity.fields
    assert (host_seq, protocol, tick_hz, cause) == (5, 1, 2_000_000, "POWER")
    assert serial.startswith("SIM-")
    assert "SIM" in name


def test_a_heartbeat_every_fifty_milliseconds_tells_state_voltage_and_whether_the_host_lives(bench):
    bench.wait(200)
    beats = [(at, m.fields) for at, m in bench.said if m.kind == "HB"]
    assert beats == [(at, ("DISARMED", OPEN, 1)) for at in (50, 100, 150, 200)]


def test_lines_are_numbered_without_a_gap(bench):
    bench.wait(300)
    assert [m.seq for _, m in bench.said] == list(range(len(bench.said)))


@pytest.mark.long
def test_numbers_go_on_from_zero_after_65535(bench):
    bench.wait(65_540 * 50)
    seqs = [m.seq for m in bench.lines("HB")]
    assert max(seqs) == 65535
    assert seqs[seqs.index(65535) + 1] == 0


def test_an_unacknowledged_line_is_sent_again_every_fifty_milliseconds_with_its_number(bench):
    bench.wait(160, host=False)
    assert [(at, m.seq) for at, m in bench.said if m.kind == "BOOT"] == [(0, 0), (50, 0), (100, 0), (150, 0)]
    bench.hear("ACK", 0)
    bench.wait(200, host=False)
    assert len(bench.lines("BOOT")) == 4


def test_a_heartbeat_is_never_said_again(bench):
    bench.wait(500, host=False)
    seqs = [m.seq for m in bench.lines("HB")]
    assert len(seqs) == len(set(seqs)) == 10


def test_arming_needs_a_loop_open_for_twenty_milliseconds():
    bench = Bench(CLOSED)
    bench.wait(100)
    assert bench.ask("ARM") == "CLOSED"
    bench.volts(OPEN)
    bench.wait(19)
    assert bench.ask("ARM") == "CLOSED"
    bench.wait(1)
    assert bench.ask("ARM") == "OK"


def test_arming_an_armed_probe_changes_nothing(armed):
    assert armed.ask("ARM") == "OK"
    assert armed.firmware.state is State.ARMED


def test_a_repeated_command_is_answered_again_but_done_once(armed):
    last = armed._seq - 1
    armed.volts(CLOSED)
    assert armed.ask("ARM", last) == "OK"  # the answer to what was done then, though it would be refused now
    assert armed.firmware.state is State.TRIPPED
    assert armed.ask("ARM") == "STATE"


def test_a_new_host_is_not_given_the_answers_of_the_one_before(armed):
    last = armed._seq - 1
    armed.volts(CLOSED)
    armed.hear("HELLO", 0)
    assert armed.ask("ARM", last) == "STATE"


def test_the_first_edge_is_reported_at_once_with_its_own_tick(armed):
    armed.wait(1.5)
    armed.volts(CLOSED)
    (edge,) = armed.lines("EDGE")
    assert edge.fields == (armed.now // 500,)
    assert armed.said[-1][1] is edge
    assert armed.firmware.state is State.TRIPPED


def test_an_edge_that_holds_is_confirmed_after_two_milliseconds(armed):
    armed.volts(CLOSED)
    armed.wait(1.9)
    assert armed.lines("CONF") == []
    armed.wait(0.1)
    (confirmed,) = armed.lines("CONF")
    assert confirmed.fields == (armed.lines("EDGE")[0].fields[0], 1, 0)


def test_a_bouncing_contact_is_one_edge_and_its_bounces_are_counted(armed):
    for level in (CLOSED, OPEN, CLOSED):
        armed.volts(level)
        armed.wait(0.3)
    armed.wait(5)
    assert len(armed.lines("EDGE")) == 1
    assert armed.lines("CONF")[0].fields[1:] == (1, 2)


def test_a_spark_is_refuted(armed):
    armed.volts(CLOSED)
    armed.wait(0.5)
    armed.volts(OPEN)
    armed.wait(2)
    assert armed.lines("CONF")[0].fields[1:] == (0, 1)


def test_the_loop_is_reported_open_twenty_milliseconds_after_it_opened_for_good(armed):
    armed.volts(CLOSED)
    armed.wait(100)
    armed.volts(OPEN)
    armed.wait(10)
    armed.volts(CLOSED)
    armed.wait(1)
    armed.volts(OPEN)
    opened = armed.now
    armed.wait(19)
    assert armed.lines("OPEN") == []
    armed.wait(60)
    (report,) = armed.lines("OPEN")
    assert report.fields == (opened // 500,)


def test_disarming_a_tripped_probe_makes_it_ready_for_the_next_search(armed):
    armed.volts(CLOSED)
    assert armed.ask("DISARM") == "OK"
    assert armed.ask("ARM") == "CLOSED"
    armed.volts(OPEN)
    armed.wait(20)
    assert armed.ask("ARM") == "OK"


def test_a_disarmed_probe_reports_no_edge(bench):
    bench.wait(30)
    bench.volts(CLOSED)
    bench.wait(10)
    assert bench.lines("EDGE", "CONF") == []


@pytest.mark.parametrize(("millivolts", "code"), [(BROKEN, "WIRE"), (3000, "RANGE"), (700, "RANGE")])
@pytest.mark.parametrize("arm", [True, False])
def test_a_loop_that_is_neither_open_nor_closed_is_a_fault_in_any_state(millivolts, code, arm):
    bench = Bench()
    if arm:
        bench.armed()
    bench.volts(millivolts)
    bench.wait(1)
    assert [m.fields for m in bench.lines("FAULT")] == [(code,)]
    assert bench.firmware.state is State.FAULT
    assert bench.ask("ARM") == ("WIRE" if code == "WIRE" else "STATE")


def test_arm_on_a_broken_wire_says_so_whatever_was_before(armed):
    armed.volts(CLOSED)
    armed.wait(10)
    assert armed.firmware.state is State.TRIPPED
    armed.volts(BROKEN)
    armed.wait(1)
    assert armed.ask("ARM") == "WIRE"
    armed.volts(OPEN)
    armed.wait(1)
    assert armed.ask("ARM") == "STATE"


def test_a_line_of_a_type_that_it_does_not_know_is_answered_so_and_changes_nothing(armed):
    assert [armed.ask("DANCE"), armed.ask("ARMS"), armed.ask("EDGE")] == ["UNKNOWN"] * 3
    assert armed.firmware.state is State.ARMED
    assert armed.firmware.dropped == 0
    armed.wait(400, host=False)
    armed.hear("DANCE")  # it is a valid line: the host lives
    armed.wait(400, host=False)
    assert armed.lines("FAULT") == []


def test_disarm_leaves_a_fault_only_once_its_cause_is_gone(armed):
    armed.volts(BROKEN)
    armed.wait(1)
    assert armed.ask("DISARM") == "WIRE"
    armed.volts(OPEN)
    armed.wait(1)
    assert armed.firmware.state is State.FAULT
    assert armed.ask("DISARM") == "OK"
    assert armed.firmware.state is State.DISARMED


def test_a_loop_broken_from_the_start_is_reported():
    assert [m.fields for m in Bench(BROKEN).lines("FAULT")] == [("WIRE",)]


def test_a_contact_of_ten_seconds_is_stuck(armed):
    armed.volts(CLOSED)
    armed.wait(9_999)
    assert armed.lines("FAULT") == []
    armed.wait(1)
    assert [m.fields for m in armed.lines("FAULT")] == [("STUCK",)]
    assert armed.ask("DISARM") == "CLOSED"
    armed.wait(20_000)
    assert len(armed.lines("FAULT")) == 1
    armed.volts(OPEN)
    assert armed.ask("DISARM") == "OK"


def test_a_host_silent_for_half_a_second_is_a_fault_while_armed(armed):
    for _, message in armed.said:
        armed.hear("ACK", message.seq)
    armed.wait(499, host=False)
    assert armed.firmware.state is State.ARMED
    armed.wait(1, host=False)
    assert [m.fields for m in armed.lines("FAULT")] == [("HOST",)]
    armed.wait(50, host=False)
    assert armed.lines("HB")[-1].fields == ("FAULT", OPEN, 0)
    assert armed.ask("DISARM") == "OK"


def test_a_host_silent_while_disarmed_only_loses_its_ok(bench):
    bench.wait(1000)
    bench.wait(600, host=False)
    assert bench.lines("FAULT") == []
    assert bench.lines("HB")[-1].fields == ("DISARMED", OPEN, 0)


def test_a_line_that_makes_no_sense_is_counted_and_is_no_sign_of_life(bench):
    bench._update([None])
    bench.wait(50, host=False)
    assert bench.firmware.dropped == 1
    assert bench.lines("HB")[-1].fields[2] == 0


def test_sync_is_answered_with_the_tick_of_its_arrival_each_time(bench):
    bench.wait(1)
    (first,) = bench.hear("SYNC", 9)
    bench.wait(2)
    (again,) = bench.hear("SYNC", 9)
    assert (first.fields, again.fields) == ((9, 2000), (9, 6000))


@pytest.mark.parametrize(
    ("name", "lowest", "highest"),
    [
        ("CLOSED", 0, 499),
        ("SENSELESS", 500, 1399),
        ("OPEN", 1400, 2500),
        ("SENSELESS", 2501, 4000),
        ("BROKEN", 4001, 5000),
    ],
)
def test_the_voltage_means_what_the_table_says(name, lowest, highest):
    assert level_of(lowest).name == level_of(highest).name == name
