"""A PLC on its own port; the test is a client that writes its bytes by hand, and lets time pass while it waits."""

from __future__ import annotations

import struct
from dataclasses import replace
from pathlib import Path

import pytest

from sims.bench import setup_of
from sims.cell import read_cell
from sims.plc._server import PlcServer
from tests.helpers.sims import TcpBench

SHIPPED = read_cell(Path(__file__).parents[3] / "procedures/cells/sphere_cell.yaml")


class Bench(TcpBench):
    """The simulated PLC, and one client."""

    def __init__(self, address="modbus+tcp://192.168.10.5:502?unit=1", **settings):
        super().__init__()
        cell = replace(SHIPPED, addresses={"plc": address})
        plc = {**cell.simulate.settings["plc"], **settings}
        cell = replace(cell, simulate=replace(cell.simulate, settings={**cell.simulate.settings, "plc": plc}))
        setup = setup_of(cell, "plc", self.kernel, self.faults)
        self.scene, self.wire = setup.scene, setup.wire
        self.server = PlcServer(setup)
        self.client = self.call()

    @property
    def port(self):
        return self.server.port

    def stop(self):
        self.server.close()

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

    def inputs(self):
        answer = self.ask(b"\x02\x00\x00\x00\x0e")
        return [bool(answer[2 + i // 8] >> i % 8 & 1) for i in range(14)]

    def registers(self):
        return struct.unpack(">11H", self.ask(b"\x04\x00\x00\x00\x0b")[2:])


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
