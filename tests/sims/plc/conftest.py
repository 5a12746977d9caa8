"""A PLC on its own port; the test is a client that writes its bytes by hand, and lets time pass while it waits."""

from __future__ import annotations

import select
import socket
import struct
import time
from dataclasses import replace
from pathlib import Path

import pytest
from simulated_devices import catalogue, read_fault, setup_of

from sims.cell import read_cell
from sims.faults import Faults
from sims.kernel import Kernel
from sims.plc.server import PlcServer

SHIPPED = read_cell(Path(__file__).parents[3] / "procedures/cells/sphere_cell.yaml")
PATIENCE_S = 60.0
MOST_TURNS = 100_000


class Bench:
    """The simulated PLC, and one client."""

    def __init__(self, address="modbus+tcp://192.168.10.5:502?unit=1", **settings):
        cell = replace(SHIPPED, addresses={"plc": address})
        plc = {**cell.simulate.settings["plc"], **settings}
        cell = replace(cell, simulate=replace(cell.simulate, settings={**cell.simulate.settings, "plc": plc}))
        self.kernel = Kernel("lockstep")
        self.faults = Faults(self.kernel, catalogue())
        setup = setup_of(cell, "plc", self.kernel, self.faults)
        self.scene, self.wire = setup.scene, setup.wire
        self.server = PlcServer(setup)
        self.clients = []
        self.client = self.call()
        self.number = 0

    def call(self):
        client = socket.create_connection(("127.0.0.1", self.server.port), timeout=PATIENCE_S)
        self.clients.append(client)
        return client

    def close(self):
        self.server.close()
        self.kernel.close()
        for client in self.clients:
            client.close()

    def ask(self, pdu, unit=1, client=None):
        """The PDU that answers a PDU; transaction, protocol and unit are checked."""
        client = client or self.client
        self.number += 1
        client.sendall(self.framed(pdu, self.number, unit))
        transaction, answered_by, answer = self.answer(client)
        assert (transaction, answered_by) == (self.number, unit)
        return answer

    @staticmethod
    def framed(pdu, transaction=1, unit=1):
        return struct.pack(">HHHB", transaction, 0, len(pdu) + 1, unit) + pdu

    def answer(self, client=None):
        client = client or self.client
        transaction, protocol, length, unit = struct.unpack(">HHHB", self.received(client, 7))
        assert protocol == 0
        return transaction, unit, self.received(client, length - 1)

    def received(self, client, count):
        """So many bytes, or fewer where the PLC hangs up; time passes until they are there."""
        data = b""
        while len(data) < count:
            self.until(lambda: select.select([client], [], [], 0)[0])
            piece = client.recv(count - len(data))
            if not piece:
                break
            data += piece
        return data

    def until(self, done):
        """Let time pass until `done()`."""
        self.kernel._heard_at = time.monotonic_ns()  # somebody is there: time need not keep to the wall
        turns = 0
        while not done():
            self.kernel._lockstep_turn()
            turns += 1
            assert turns < MOST_TURNS

    def inputs(self):
        answer = self.ask(b"\x02\x00\x00\x00\x0e")
        return [bool(answer[2 + i // 8] >> i % 8 & 1) for i in range(14)]

    def registers(self):
        return struct.unpack(">11H", self.ask(b"\x04\x00\x00\x00\x0b")[2:])

    def fault(self, name, **settings):
        """A fault from now on."""
        self.faults.schedule(read_fault({"fault": name, "at_ms": self.kernel.now / 1e6, **settings}))
        self.let_pass(0.0)

    def let_pass(self, seconds):
        reached = []
        self.kernel.after(round(seconds * 1e9), lambda: reached.append(True))
        self.until(lambda: reached)


@pytest.fixture
def bench():
    """Start a PLC: `bench(clamp_ms=300)`."""
    benches = []

    def begin(*address, **settings):
        benches.append(Bench(*address, **settings))
        return benches[-1]

    yield begin
    for one in benches:
        one.close()
