"""Drives by hand on a `virtual` bus in this process: frames as bytes, with no CANopen library on their side."""

import asyncio
import itertools
import struct
from dataclasses import dataclass, field

import can
import pytest

from cellctl.clock import WallClock
from cellctl.devices import Address, Surroundings
from cellctl.devices.registry import DriverRegistry

_CHANNELS = itertools.count()


@dataclass
class HandMadeDrive:
    """One node. `objects`: (index, sub-index) → bytes; `written`: what the master set, in order; `current`, `torque`:
    of its frames, per mille; `answers`: frames for each SYNC."""

    number: int
    objects: dict = field(default_factory=dict)
    written: list = field(default_factory=list)
    current: int = 0
    torque: int = 0
    position: int = 0
    answers: int = 1
    dead: bool = False
    state: int = 127

    def __post_init__(self):
        self.objects = {
            (0x1000, 0): struct.pack("<I", 0x20192),
            (0x1008, 0): b"HAND",
            (0x100A, 0): b"1.2",
            (0x1018, 4): struct.pack("<I", 40 + self.number),
            (0x6041, 0): struct.pack("<H", 0x0237),
            (0x603F, 0): struct.pack("<H", 0),
            (0x6075, 0): struct.pack("<I", 5000),
            (0x6076, 0): struct.pack("<I", 2000),
        } | self.objects

    def hear(self, can_id, data):
        """The frames that answer one from the master."""
        if self.dead:
            return []
        if can_id == 0 and data[1] in (0, self.number):
            self.state = {0x01: 5, 0x02: 4, 0x80: 127}[data[0]]
            return [self.heartbeat()] if self.state == 5 else []
        if can_id == 0x80 and self.state == 5:
            return [(0x180 + self.number, struct.pack("<ihh", self.position, self.current, self.torque))] * self.answers
        return [(0x580 + self.number, self._sdo(data))] if can_id == 0x600 + self.number else []

    def heartbeat(self, state=None):
        return 0x700 + self.number, bytes([self.state if state is None else state])

    def _sdo(self, data):
        place = struct.unpack_from("<HB", data, 1)
        if data[0] & 0xE0 == 0x20:
            self.written.append((*place, int.from_bytes(data[4 : 8 - (data[0] >> 2 & 3)], "little")))
            return b"\x60" + data[1:4] + bytes(4)
        if data[0] == 0x40 and place in self.objects:
            value = self.objects[place]
            return bytes([0x43 | (4 - len(value)) << 2]) + data[1:4] + value.ljust(4, b"\0")
        return b"\x80" + data[1:4] + struct.pack("<I", 0x06020000)


class HandMadeBus:
    """The drives' side of the bus; a task answers the master's frames."""

    def __init__(self, nodes):
        self.channel = f"hand-made-{next(_CHANNELS)}"
        self.drives = {number: HandMadeDrive(number) for number in nodes}
        self.bus = can.Bus(interface="virtual", channel=self.channel)
        self.on_sync = lambda: None
        self._answering = asyncio.create_task(self._answer())

    def send(self, can_id, data):
        self.bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))

    async def _answer(self):
        while True:
            while message := self.bus.recv(0):
                if message.arbitration_id == 0x80:
                    self.on_sync()
                for drive in self.drives.values():
                    for frame in drive.hear(message.arbitration_id, bytes(message.data)):
                        self.send(*frame)
            await asyncio.sleep(0.001)

    async def close(self):
        self._answering.cancel()
        await asyncio.gather(self._answering, return_exceptions=True)
        self.bus.shutdown()


@pytest.fixture
def on_bus(tmp_path):
    """Runs a coroutine function with (bus, drives) on hand-made drives."""

    def run(story, nodes=(1, 2), settings=""):
        async def go():
            bus = HandMadeBus(nodes)
            text = f"canopen+virtual://{bus.channel}?nodes={','.join(map(str, nodes))}{settings}"
            surroundings = Surroundings(WallClock(), tmp_path, {}, None)
            drives = DriverRegistry().open("drives", Address.parse(text), surroundings)
            try:
                await story(bus, drives)
            finally:
                await drives.close()
                await bus.close()

        asyncio.run(asyncio.wait_for(go(), 60.0))

    return run
