"""The controller's process in lockstep: its time waits for the host that has attached."""

from __future__ import annotations

import json
import select
import socket
import struct
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest

from tests.helpers.runs import ROOT
from tests.sims.ur.conftest import RTDE

CELL = Path(__file__).parent / "ur10e_cell.yaml"
PATIENCE_S = 120.0


class Host:
    """A host that reads every byte before it lets time go on, and counts what it writes."""

    def __init__(self, ready):
        place, port = ready["control"].split(":")
        self.control = socket.create_connection((place, int(port)), timeout=PATIENCE_S)
        self.lines = self.control.makefile("rw")
        self.stream = None
        self.robot = ready["robot"].removeprefix("ur+rtde://")
        self.written, self.read = 0, b""
        self.tell(op="attach", name="test")
        self.tick = json.loads(self.lines.readline())

    def tell(self, **message):
        self.lines.write(json.dumps(message) + "\n")
        self.lines.flush()

    def call(self):
        self.stream = socket.create_connection((self.robot, RTDE), timeout=PATIENCE_S)

    def send(self, kind, content=b""):
        package = struct.pack(">Hc", 3 + len(content), kind) + content
        self.stream.sendall(package)
        self.written += len(package)

    def go_on(self):
        """Done with this tick; then everything of the next is read."""
        self.tell(tock=self.tick["tick"], wires={"robot": self.written}, next=None)
        self.tick = json.loads(self.lines.readline())
        while len(self.read) < self.tick["wires"]["robot"]:
            self.read += self.stream.recv(65536)


@pytest.fixture
def host():
    command = [sys.executable, "-m", "sims", "run", str(CELL), "--clock", "lockstep", "--wait-for-host"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT)
    host = Host(json.loads(process.stdout.readline()))
    yield host
    host.control.close()
    if host.stream:
        host.stream.close()
    process.terminate()
    process.communicate()


def packages(data):
    while data:
        size, kind = struct.unpack_from(">Hc", data)
        yield kind, data[3:size]
        data = data[size:]


def test_each_package_is_a_tick_and_time_waits_until_the_host_has_answered_it(host):
    host.call()
    host.send(b"V", struct.pack(">H", 2))
    host.send(b"O", struct.pack(">d", 500.0) + b"timestamp")
    host.send(b"S")
    while len(host.read) < 3 * 4 + 20 * 12:
        host.go_on()
    assert not select.select([host.stream], [], [], 0.2)[0]  # nothing comes while the tick is unanswered
    times = [struct.unpack_from(">d", content, 1)[0] for kind, content in packages(host.read) if kind == b"U"]
    steps = {round((b - a) * 1e6) for a, b in pairwise(times)}
    assert steps == {2000}
    assert host.tick["tick"] == pytest.approx(times[-1] * 1e9)
