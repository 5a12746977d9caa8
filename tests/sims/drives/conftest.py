"""The simulated drives on their bus, and a master by hand: frames as bytes, with no CANopen library on this side."""

import struct
from contextlib import suppress
from dataclasses import dataclass, replace

import can
import pytest

from sims.bench import catalogue, setup_of
from sims.drives._server import DriveServer
from sims.faults import Faults
from sims.kernel import Kernel
from tests.helpers.sims import with_errors

MS = 1_000_000


@dataclass
class Bench:
    """`run(ms)` lets the cell's time pass and returns the drives' frames as (COB-ID, data)."""

    server: DriveServer
    kernel: Kernel
    faults: Faults
    scene: object
    bus: can.BusABC
    wire: object

    def send(self, can_id, *data):
        self.bus.send(can.Message(arbitration_id=can_id, data=bytes(data), is_extended_id=False))

    def run(self, ms=2.0):
        end = self.kernel.at(self.kernel.now + round(ms * MS), lambda: None)
        while end.pending:
            self.kernel._lockstep_turn()  # `run` collects garbage first, which would take most of a test's time
        frames = []
        while message := self._next():
            if message.arbitration_id not in (0x000, 0x080) and message.arbitration_id & 0x780 not in (0x600, 0x200):
                frames.append((message.arbitration_id, bytes(message.data)))
        return frames

    def _next(self):
        with suppress(can.CanOperationError):  # what a test sent that is no frame
            return self.bus.recv(0)
        return self.bus.recv(0)

    def ask(self, can_id, *data):
        self.send(can_id, *data)
        return self.run()

    def read(self, node, index, subindex=0):
        """An object of up to four bytes, by SDO."""
        ((can_id, answer),) = self.ask(0x600 + node, 0x40, index & 0xFF, index >> 8, subindex, 0, 0, 0, 0)
        assert can_id == 0x580 + node
        assert answer[0] & 0xE3 == 0x43, answer.hex()
        return int.from_bytes(answer[4 : 8 - (answer[0] >> 2 & 3)], "little")

    def write(self, node, index, subindex, value, size):
        """Write an object by SDO; the abort code, 0 if it was taken."""
        command = 0x23 | (4 - size) << 2
        data = struct.pack("<BHB", command, index, subindex) + value.to_bytes(4, "little")
        ((can_id, answer),) = self.ask(0x600 + node, *data)
        assert can_id == 0x580 + node
        assert answer[1:4] == data[1:4]
        return int.from_bytes(answer[4:], "little") if answer[0] == 0x80 else 0

    def map(self, node, *entries):
        """TPDO1 with each SYNC, in the order that drives need."""
        self.send(0x000, 0x80, node)
        steps = [(0x1800, 1, 0x8000_0180 + node, 4), (0x1A00, 0, 0, 1)]
        steps += [(0x1A00, number, entry, 4) for number, entry in enumerate(entries, 1)]
        steps += [(0x1A00, 0, len(entries), 1), (0x1800, 2, 1, 1), (0x1800, 1, 0x180 + node, 4)]
        return [self.write(node, *step) for step in steps]


@pytest.fixture
def cell():
    return replace(with_errors(), addresses={"drives": "canopen+socketcan://can0?bitrate=1000000&nodes=1,2,3,4,5,6"})


@pytest.fixture
def bench(cell, kernel):
    faults = Faults(kernel, catalogue())
    setup = setup_of(cell, "drives", kernel, faults)
    server = DriveServer(setup)
    port = int(server.address.split("?")[0].rpartition(":")[2])
    bus = can.Bus(interface="udp_multicast", channel="239.74.163.2", port=port, hop_limit=0, fd=False)
    yield Bench(server, kernel, faults, setup.scene, bus, setup.wire)
    bus.shutdown()
    server.close()
