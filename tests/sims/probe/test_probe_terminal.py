"""The probe on a real pseudo-terminal, with a host written by hand from the protocol's document."""

import os
import re
import select
import threading

import pytest

from sims.bench import catalogue, setup_of
from sims.cell import read_cell
from sims.faults import Faults
from sims.kernel import Kernel
from sims.probe._server import ProbeServer
from tests.helpers.sims import read_fault

MS = 1_000_000
PATIENCE_S = 90


def crc16_bitwise(data):
    """CRC-16/CCITT-FALSE a bit at a time, apart from the simulator's."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = ((crc << 1) ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


class Host:
    """A host at the other end. What it reads is in `lines`, split at commas, and what fails its check in `torn`."""

    def __init__(self, path):
        self.fd = os.open(path, os.O_RDWR | os.O_NOCTTY)
        self.lines, self.torn, self._begun, self._seq = [], [], b"", 0

    def say(self, body):
        data = body.encode()
        os.write(self.fd, data + b"*%04X\n" % crc16_bitwise(data))

    def ask(self, kind):
        self.say(f"{kind},{self._seq}")
        self._seq += 1

    def read(self):
        """The next valid line, without acknowledging it."""
        while True:
            while b"\n" not in self._begun:
                if not select.select([self.fd], [], [], PATIENCE_S)[0]:
                    raise TimeoutError("nothing comes from the probe")
                self._begun += os.read(self.fd, 4096)
            line, self._begun = self._begun.split(b"\n", 1)
            body, _, check = line.rpartition(b"*")
            if re.fullmatch(rb"[0-9A-F]{4}", check) and int(check, 16) == crc16_bitwise(body):
                self.lines.append(body.decode().split(","))
                return self.lines[-1]
            self.torn.append(line)

    def acknowledge(self, line):
        self.say(f"ACK,{line[1]}")

    def until(self, kind):
        """Read and acknowledge up to a line of this kind."""
        while True:
            line = self.read()
            self.acknowledge(line)
            if line[0] == kind:
                return line

    def close(self):
        os.close(self.fd)


class Running:
    """A probe on a kernel in a thread of its own."""

    def __init__(self, cell, mode="lockstep"):
        self.kernel = Kernel(mode)
        self.faults = Faults(self.kernel, catalogue())
        setup = setup_of(cell, "probe", self.kernel, self.faults)
        self.loop, self.probe = setup.scene.contact, ProbeServer(setup)
        self._asked = os.pipe()
        self._todo = []
        self.kernel.watch(self._asked[0], self._do)
        self._thread = threading.Thread(target=self.kernel.run)
        self._thread.start()

    def call(self, action):
        """Do `action` in the kernel's own thread, and wait until it is done."""
        done = threading.Event()
        self._todo.append(lambda: (action(), done.set()))
        os.write(self._asked[1], b"!")
        assert done.wait(PATIENCE_S)

    def fault(self, **entry):
        self.call(lambda: self.faults.schedule(read_fault(entry)))

    def _do(self):
        os.read(self._asked[0], 1)
        self._todo.pop(0)()

    def end(self):
        self.kernel.stop()
        self._thread.join(PATIENCE_S)
        assert not self._thread.is_alive()
        self.probe.close()
        self.kernel.close()
        for end in self._asked:
            os.close(end)


@pytest.fixture(scope="module")
def cell(request):
    return read_cell(request.config.rootpath / "procedures/cells/sphere_cell.yaml")


@pytest.fixture
def running(cell):
    running = Running(cell)
    yield running
    running.end()


@pytest.fixture
def host(running):
    host = Host(running.probe.path)
    yield host
    host.close()


def armed(host):
    host.ask("HELLO")
    host.until("ID")
    host.until("HB")  # by then the loop has been seen open for long enough
    host.ask("ARM")
    assert host.until("RE")[4] == "OK"
    return host


def test_a_host_that_says_hello_learns_that_the_probe_is_simulated(host):
    host.ask("HELLO")
    identity = host.until("ID")
    assert identity[3:5] == ["0", "1"]
    assert "SIM" in identity[6]
    assert identity[7].startswith("SIM-")


def test_an_armed_probe_tells_contact_confirmation_and_opening(running, host):
    armed(host)
    running.call(lambda: running.loop.set_closed(True))
    edge = host.until("EDGE")
    confirmed = host.until("CONF")
    assert confirmed[3:] == [edge[3], "1", "2"]
    running.call(lambda: running.loop.set_closed(False))
    host.until("OPEN")


def test_in_lockstep_time_stands_still_until_a_line_is_acknowledged(running, host):
    armed(host)
    line = host.read()
    times = []
    for _ in range(3):
        running.call(lambda: times.append((running.kernel.now, running.kernel.holders())))
    assert len(set(map(str, times))) == 1
    assert times[0][1] == ["probe"]
    host.acknowledge(line)
    host.until("HB")
    running.call(lambda: times.append(running.kernel.now))
    assert times[-1] > times[0][0]


def test_a_reset_shows_itself_and_forgets_that_the_probe_was_armed(running, host):
    armed(host)
    running.fault(fault="probe.reset")
    boot = host.until("BOOT")
    assert boot[1] == "0"
    assert boot[3:] == ["1", "WATCHDOG"]
    assert int(boot[2]) == pytest.approx(600_000, abs=100)  # 300 ms of a count begun anew
    assert host.until("HB")[3] == "DISARMED"


def test_a_probe_fallen_silent_is_heard_again_with_what_it_had_to_say(running, host):
    armed(host)
    silence = read_fault({"fault": "probe.silent", "for_ms": 200})
    before = len(host.lines)
    running.call(lambda: (running.faults.schedule(silence), running.loop.set_closed(True)))
    edge = host.until("EDGE")
    kinds = [line[0] for line in host.lines[before:]]
    assert kinds.count("HB") < 3
    assert int(edge[2]) - int(edge[3]) >= 2 * 150_000  # said 150 ms after it was captured, at the least


def test_a_corrupted_line_fails_its_check_and_does_not_stop_time(running, host):
    armed(host)
    running.fault(fault="probe.corrupt", every=2, for_ms=500)
    for _ in range(12):
        host.until("HB")
    assert 3 <= len(host.torn) <= 8


def test_a_broken_wire_is_reported_at_once(running, host):
    armed(host)
    running.fault(fault="probe.wire_break")
    assert host.until("FAULT")[3] == "WIRE"
    assert host.until("HB")[3] == "FAULT"


def test_time_does_not_wait_for_a_host_that_hung_up(running):
    host = armed(Host(running.probe.path))
    host.read()
    host.close()  # with a line unacknowledged
    seen = threading.Event()
    running.call(lambda: running.kernel.after(200 * MS, seen.set))
    assert seen.wait(PATIENCE_S)


def test_a_second_host_finds_the_probe_after_the_first_has_hung_up(running):
    armed(Host(running.probe.path)).close()
    second = Host(running.probe.path)
    second.ask("HELLO")
    second.until("ID")
    second.close()


@pytest.mark.long
def test_a_probe_that_nobody_listens_to_goes_on(running):
    two_minutes_on = threading.Event()  # more heartbeats than the terminal holds
    running.call(lambda: running.kernel.after(120_000 * MS, two_minutes_on.set))
    while not two_minutes_on.wait(0.1):
        running.call(lambda: None)  # with nobody to be heard for a second, it would take two minutes
    host = Host(running.probe.path)
    host.ask("HELLO")
    host.until("ID")
    assert len(host.lines) + len(host.torn) < 1000  # and a host to come finds no two minutes of old lines
    host.close()


@pytest.mark.realtime
def test_in_real_time_nothing_waits_for_the_acknowledgement(cell):
    running = Running(cell, "realtime")
    host = Host(running.probe.path)
    host.ask("HELLO")
    beats = [line for line in (host.read() for _ in range(12)) if line[0] == "HB"]
    assert len(beats) >= 2
    host.close()
    running.end()
