"""The control port: ticks and tocks, faults, status, shutdown, over real sockets."""

import json
import socket
import threading
from itertools import pairwise

import pytest

from sims import kernel as kernel_module
from sims.bench import catalogue
from sims.control import STRIDE_NS, ControlPort
from sims.faults import Faults
from sims.kernel import Kernel
from sims.krc._rsi_exchange import target_of
from sims.scene.safety import Safety
from sims.wires import Wire

MS = 1_000_000
PATIENCE_S = 90


class Host:
    """A connection to the control port."""

    def __init__(self, address):
        host, port = address.split(":")
        self.stream = socket.create_connection((host, int(port)), timeout=PATIENCE_S)
        self._lines = self.stream.makefile("rb")

    def say(self, message):
        self.raw(json.dumps(message).encode() + b"\n")

    def raw(self, data):
        self.stream.sendall(data)

    def hear(self):
        return json.loads(self._lines.readline())

    def ask(self, **message):
        self.say(message)
        return self.hear()

    def tock(self, count):
        """Answer so many ticks; returns the last one's time."""
        for _ in range(count):
            time_ns = self.hear()["tick"]
            self.say({"tock": time_ns})
        return time_ns

    def close(self):
        self._lines.close()
        self.stream.close()


class Cell:
    """A kernel whose heart beats each 7 ms, with a control port, in a thread of its own."""

    def __init__(self, mode="lockstep", *, wait_for_host=False):
        self.kernel, self.targets = Kernel(mode), []
        self.faults, self.wire = Faults(self.kernel, catalogue()), Wire()
        self.safety, self.acknowledged = Safety(self.faults), []
        requests = {
            "robot": {
                "rsi_target": lambda message: self.targets.append(target_of(message)),
                "acknowledge": lambda _: self.acknowledged.append(self.safety.ok),
            },
            "probe": {},
        }
        self.port = ControlPort(self.kernel, self.faults, requests, self.safety, {"probe": self.wire})
        self.kernel.after(7 * MS, self._beat)
        if wait_for_host:
            self.port.wait_for_host()
        self._thread = threading.Thread(target=self.kernel.run)
        self._thread.start()

    def _beat(self):
        self.kernel.after(7 * MS, self._beat)

    def ended(self):
        self._thread.join(PATIENCE_S)
        return not self._thread.is_alive()

    def end(self):
        self.kernel.stop()
        assert self.ended()
        self.port.close()
        self.kernel.close()


@pytest.fixture
def cell():
    cell = Cell()
    yield cell
    cell.end()


@pytest.fixture
def host(cell):
    host = Host(cell.port.address)
    yield host
    host.close()


def test_an_attached_host_gets_the_time_every_twenty_milliseconds(host):
    host.say({"op": "attach", "name": "engine"})
    ticks = []
    for _ in range(5):
        ticks.append(host.hear()["tick"])
        host.say({"tock": ticks[-1]})
    assert {b - a for a, b in pairwise(ticks)} == {STRIDE_NS}


def test_time_does_not_go_on_until_the_host_has_answered(cell, host):
    host.say({"op": "attach", "name": "engine"})
    tick = host.hear()["tick"]
    other = Host(cell.port.address)
    seen = [other.ask(op="status") for _ in range(3)]
    other.close()
    assert [status["time_ns"] for status in seen] == [tick] * 3
    assert seen[0]["holds"] == ["host engine"]


def test_an_answer_to_an_older_tick_does_not_let_time_go_on(host):
    host.say({"op": "attach", "name": "engine"})
    older = host.tock(1)
    tick = host.hear()["tick"]
    host.say({"tock": older})
    assert host.ask(op="status")["time_ns"] == tick


def test_time_goes_on_without_a_host_that_has_hung_up(cell, host):
    attached = Host(cell.port.address)
    attached.say({"op": "attach", "name": "engine"})
    tick = attached.hear()["tick"]
    attached.close()
    times = [host.ask(op="status")["time_ns"]]
    while times[-1] <= tick + STRIDE_NS and len(times) < 100_000:
        times.append(host.ask(op="status")["time_ns"])
    assert times[-1] > tick + STRIDE_NS


def test_after_a_hang_up_the_next_host_can_attach(cell):
    for _ in range(3):
        host = Host(cell.port.address)
        host.say({"op": "attach", "name": "engine"})
        host.tock(3)
        host.close()


def test_time_stands_at_zero_until_a_host_attaches_where_that_was_asked_for():
    cell = Cell(wait_for_host=True)
    host = Host(cell.port.address)
    assert [host.ask(op="status")["time_ns"] for _ in range(20)] == [0] * 20
    host.say({"op": "attach", "name": "engine"})
    assert host.hear()["tick"] == 0
    host.say({"tock": 0})
    assert host.hear()["tick"] == STRIDE_NS
    host.close()
    cell.end()


def test_what_an_event_writes_is_ticked_before_the_next_event_and_counted(cell, host):
    cell.kernel.every_half_second(lambda: None)
    host.say({"op": "attach", "name": "engine"})
    tick = host.hear()
    assert tick["wires"] == {"probe": 0}
    cell.kernel.at(tick["tick"] + 3 * MS, lambda: cell.wire.wrote(40))  # in the middle of a stride
    cell.kernel.at(tick["tick"] + 3 * MS, lambda: cell.wire.wrote(2))
    host.say({"tock": tick["tick"]})
    for written in (40, 42):
        assert host.hear() == {"tick": tick["tick"] + 3 * MS, "wires": {"probe": written}}
        host.say({"tock": tick["tick"] + 3 * MS})
    assert host.hear()["tick"] == tick["tick"] + 23 * MS


def test_time_waits_for_what_the_host_says_it_has_written(cell, host):
    host.say({"op": "attach", "name": "engine"})
    tick = host.hear()["tick"]
    cell.wire.opened()
    host.say({"tock": tick, "wires": {"probe": 12, "a wire that is not simulated": 5}})
    assert host.ask(op="status")["time_ns"] == tick
    cell.kernel.stop()
    cell.ended()
    cell.wire.read(12)
    assert cell.kernel.holders() == []


def test_a_host_whose_bytes_were_lost_gets_its_next_tick_when_the_wait_for_them_was_given_up(cell, host, monkeypatch):
    monkeypatch.setattr(kernel_module, "PATIENCE_NS", 100 * MS)
    host.say({"op": "attach", "name": "engine"})
    tick = host.hear()["tick"]
    cell.wire.opened()
    host.say({"tock": tick, "wires": {"probe": 12}})
    later = host.hear()["tick"]
    assert later > tick
    cell.wire.read(12)
    host.say({"tock": later, "wires": {"probe": 12}})
    assert host.hear()["tick"] > later


def test_time_does_not_wait_for_bytes_of_a_host_that_was_hung_up_on(cell, host):
    host.say({"op": "attach", "name": "engine"})
    cell.wire.cut()
    for _ in range(3):
        host.say({"tock": host.hear()["tick"], "wires": {"probe": 1000}})


def test_counts_that_are_no_numbers_are_refused(host):
    host.say({"op": "attach", "name": "engine"})
    tick = host.hear()["tick"]
    assert host.ask(tock=tick, wires={"probe": "many"})["ok"] is False


def test_only_one_host_is_attached(cell, host):
    host.say({"op": "attach", "name": "engine"})
    host.hear()
    other = Host(cell.port.address)
    assert other.ask(op="attach", name="console") == {"ok": False, "error": "'engine' is attached already"}
    other.close()


@pytest.mark.realtime
def test_in_real_time_there_is_nothing_to_attach_to():
    cell = Cell("realtime")
    host = Host(cell.port.address)
    assert host.ask(op="attach", name="engine")["ok"] is False
    assert host.ask(op="status")["mode"] == "realtime"
    host.close()
    cell.end()


def test_the_robot_gets_the_address_for_its_telegrams(cell, host):
    assert host.ask(op="rsi_target", device="robot", host="127.0.0.1", port=49152) == {"ok": True}
    assert cell.targets == [("127.0.0.1", 49152)]


@pytest.mark.parametrize(
    "target",
    [
        {"device": "gantry", "host": "127.0.0.1", "port": 1},
        {"device": "robot", "host": "127.0.0.1", "port": 0},
        {"device": "robot", "host": "127.0.0.1", "port": "49152"},
        {"device": "robot", "port": 49152},
        {"device": ["robot"], "host": "127.0.0.1", "port": 49152},
        {},
    ],
)
def test_a_target_that_makes_no_sense_is_refused(cell, host, target):
    answer = host.ask(op="rsi_target", **target)
    assert answer["ok"] is False
    assert answer["error"]
    assert cell.targets == []


def test_a_fault_is_scheduled_as_in_the_cell_file(cell, host):
    started = threading.Event()
    cell.faults.on_start("probe.wire_break", started.set)
    assert host.ask(op="fault", fault="probe.wire_break") == {"ok": True}
    assert started.wait(PATIENCE_S)
    assert "no setting 'every'" in host.ask(op="fault", fault="rsi.stall", every=3)["error"]


def test_the_status_counts_searches_and_all_other_events(cell, host):
    cell.faults.announce("robot.search")
    cell.faults.announce("probe.arm")
    status = host.ask(op="status")
    assert status["searches"] == 1
    assert status["events"] == {"robot.search": 1, "probe.arm": 1}


def test_shutdown_is_answered_and_ends_the_cell(cell, host):
    assert host.ask(op="shutdown") == {"ok": True}
    assert cell.ended()


@pytest.mark.parametrize(
    "line",
    [
        b"\n",
        b"hello\n",
        b"[1]\n",
        b'"attach"\n',
        b'{"op": 5}\n',
        b"\xff\xfe\n",
        b'{"tock": "x"}\n',
        b"[" * 20_000 + b"\n",
    ],
)
def test_a_line_that_is_not_understood_is_answered_so_and_harms_nothing(host, line):
    host.raw(line)
    assert host.hear()["ok"] is False
    assert host.ask(op="status")["ok"] is True


def test_requests_may_come_split_or_joined(host):
    request = json.dumps({"op": "status"}).encode() + b"\n"
    host.raw(request + request[:5])
    assert host.hear()["ok"] is True
    host.raw(request[5:])
    assert host.hear()["ok"] is True


def test_a_line_without_end_is_hung_up_on(host):
    def talk_on():
        for _ in range(20):
            host.raw(b"x" * 65_536)
        host.hear()

    with pytest.raises((ConnectionError, json.JSONDecodeError)):
        talk_on()


def test_a_reset_closes_the_safety_chain_before_it_acknowledges(cell, host):
    cell.safety.open_guard()
    cell.safety.open_emergency_stop()
    assert host.ask(op="reset") == {"ok": True}
    assert cell.acknowledged == [True]
