"""The simulated UR controller on its own ports; the test is a client that writes its bytes by hand, time passes."""

from __future__ import annotations

import re
import socket
import struct
from dataclasses import replace
from pathlib import Path

import pytest

from sims.bench import setup_of
from sims.cell import ERRORS, read_cell
from sims.memory import Memory
from sims.robot_file import Tool
from sims.ur._servers import start
from tests.helpers.sims import PATIENCE_S, TcpBench

SHIPPED = read_cell(Path(__file__).parent / "ur10e_cell.yaml")
CELL = replace(SHIPPED, robot=replace(SHIPPED.robot, tool=Tool((0.0, 0.0, 150.0), (0.0, 0.0, 0.0), 1.0)))
"""With a probe at the flange, 150 mm long."""
DASHBOARD, PRIMARY, SECONDARY, REALTIME, RTDE = 29999, 30001, 30002, 30003, 30004


class Bench(TcpBench):
    """The simulated controller; `script` is a client of the primary interface, from the first use."""

    MOST_TURNS = 400_000

    def __init__(self, cell=CELL, errors=None, folder=None, **settings):
        super().__init__()
        ur = {**cell.simulate.settings["ur"], **settings}
        simulate = replace(cell.simulate, settings={**cell.simulate.settings, "ur": ur})
        if errors is not None:
            simulate = replace(simulate, errors=dict.fromkeys(ERRORS, 0.0) | errors)
        cell = replace(cell, simulate=simulate, path=(folder / "cell.yaml") if folder else cell.path)
        setup = setup_of(cell, "robot", self.kernel, self.faults, memory=Memory())
        self.scene, self.wire = setup.scene, setup.wire
        self.servers = start(setup)
        self.controller = self.servers.controller
        self.motion, self.board, self.log = self.controller.motion, self.controller.board, self.controller.messages.log
        self._dashboard = None

    def stop(self):
        self.servers.close()

    def call(self, port):
        client = socket.create_connection((self.servers.host, port), timeout=PATIENCE_S)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)  # time does not wait for delayed acknowledgements
        self.clients.append(client)
        return client

    def rtde(self, version=2):
        return RtdeBench(self, version)

    def command(self, line):
        """The Dashboard's answer."""
        if self._dashboard is None:
            self._dashboard = self.call(DASHBOARD)
            assert self.line(self._dashboard) == "Connected: Universal Robots Dashboard Server"
        self._dashboard.sendall(line.encode() + b"\n")
        return self.line(self._dashboard)

    def line(self, client):
        text = b""
        while not text.endswith(b"\n"):
            piece = self.received(client, 1)
            if not piece:
                break
            text += piece
        return text.decode().rstrip("\n")

    def run(self, body, seconds=None, name="test"):
        """A program, executed to its end, or for so long; what it has written by `textmsg`."""
        del self.log[:]
        self.controller.runtime.take(program(body, name))
        if seconds is None:
            self.until(lambda: not self.controller.runtime.active)
        else:
            self.let_pass(seconds)
        return list(self.log)

    def settle(self):
        """Until the arm stands."""
        self.until(lambda: not self.motion.moving)


def program(body, name="test"):
    lines = [line for line in body.splitlines() if line.strip()]
    return f"def {name}():\n" + "\n".join("  " + line for line in lines) + "\nend\n"


class RtdeBench:
    """A client of RTDE, written from the guide."""

    def __init__(self, bench, version):
        self.bench, self.version = bench, version
        self.client = bench.call(RTDE)
        self.types = []
        self.texts = []
        if version > 1:
            assert self.ask(b"V", struct.pack(">H", version)) == b"\x01"

    def send(self, kind, content=b""):
        self.client.sendall(struct.pack(">Hc", 3 + len(content), kind) + content)

    def receive(self):
        size, kind = struct.unpack(">Hc", self.bench.received(self.client, 3))
        return kind, self.bench.received(self.client, size - 3)

    def ask(self, kind, content=b""):
        self.send(kind, content)
        while True:
            got, answer = self.receive()
            if got == kind:
                return answer

    def outputs(self, *names, frequency=500.0):
        """The types; an empty list where one is not found."""
        head = struct.pack(">d", frequency) if self.version > 1 else b""
        answer = self.ask(b"O", head + ",".join(names).encode())
        self.types = answer[self.version > 1 :].decode().split(",")
        return self.types

    def inputs(self, *names):
        """The recipe's number, and the types."""
        answer = self.ask(b"I", ",".join(names).encode())
        return answer[0], answer[1:].decode().split(",")

    def start(self):
        return self.ask(b"S") == b"\x01"

    def package(self):
        """The values of the next data package, one after the other."""
        while True:
            kind, content = self.receive()
            if kind == b"U":
                break
            self.texts.append(content)
        formats = {"DOUBLE": "d", "UINT32": "I", "INT32": "i", "UINT64": "Q", "BOOL": "?", "UINT8": "B"}
        shape = ""
        for kind in self.types:
            match = re.fullmatch(r"VECTOR(\d)D|VECTOR6(INT32)", kind)
            shape += formats[kind] if match is None else f"{match[1]}d" if match[1] else "6i"
        return struct.unpack(">" + shape, content[self.version > 1 :])

    def write(self, recipe, shape, *values):
        self.send(b"U", bytes([recipe]) + struct.pack(">" + shape, *values))
        self.bench.let_pass(0.004)


@pytest.fixture
def bench():
    """Start a controller: `bench(series="cb3")`."""
    benches = []

    def begin(**settings):
        benches.append(Bench(**settings))
        return benches[-1]

    yield begin
    for one in benches:
        one.close()
