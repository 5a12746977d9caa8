"""A UR10e with a wire probe at one sphere, its simulator in a process of its own, in lockstep; a server of bytes."""

from __future__ import annotations

import asyncio
import struct
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from cellctl.clock import WallClock
from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.operations.cell_devices import SimulatedCell
from drivers.ur_rtde.codec import Kind, packed
from drivers.ur_rtde.line import RtdeLine
from drivers.ur_rtde.state import OUTPUTS

ROOT = Path(__file__).parents[3]
PATIENCE_S = 120.0

CELL = """name: ur cell
model: {root}/procedures/robots/ur10e_probe.yaml
devices: {{robot: "ur+rtde://192.168.56.101{query}"}}
limits: {{robot: {{speed_percent: 50, speed_deg_s: 2.5, travel_deg: 5}}}}
artefact:
  tip_radius: 0.6
  spheres: [{{id: S2, diameter: 61.4, centre: [700, 350, 100]}}]
  distances: []
postures: {{home: [175.8, -51.9, 76.5, -82.3, -48, 49.4]}}
simulate:
  seed: 1
  {simulate}
  ur: {{probe_input: 0, programs: ., program: cellctl.urp, series: {series}}}
"""
HOME = (175.8, -51.9, 76.5, -82.3, -48.0, 49.4)
BEFORE = (175.5303, -56.7893, 90.5277, -91.3494, -48.1208, 49.1357)
"""Ten millimetres before the sphere."""

INSIDE = (175.4753, -57.5198, 92.8661, -92.9156, -48.1503, 49.0733)
"""As far inside as a search without contact would end."""


class RobotOnWire:
    """The driver's device, a second one on the same simulator, the cell's clock and the simulator's control port."""

    def __init__(self, robot, second, clock, simulated):
        self.robot, self.second, self.clock, self._simulated = robot, second, clock, simulated
        self.host = simulated.address("robot").host
        self.identity = None

    async def fault(self, name, **settings):
        """A fault from now on, or at its event."""
        await self.tell({"op": "fault", "fault": name, **settings})

    async def tell(self, message):
        with self.clock.standing():
            await self._simulated.tell(message)

    async def later(self, seconds, work):
        """`work()` after so many seconds of the cell's time."""
        await self.clock.sleep(seconds)
        await work()

    async def stands(self):
        """Whether the robot stands, as a connection of its own sees it: two looks, half a second apart."""
        line = RtdeLine("robot", (self.host, 30004), self.clock)
        await line.open()
        try:
            async with line.streaming(10.0):
                before = (await line.next(1.0)).joints
                await self.clock.sleep(0.5)
                after = (await line.next(1.0)).joints
        finally:
            await line.close()
        return max(abs(a - b) for a, b in zip(before, after, strict=True)) < 1e-3


@pytest.fixture
def on_wire(tmp_path):
    """Runs `work(wire)` on the connected robot; `script` changes the text of the resident program."""

    @asynccontextmanager
    async def opened(simulate, query, series, script):
        path = tmp_path / "cell.yaml"
        path.write_text(CELL.format(root=ROOT, simulate=simulate, query=query, series=series))
        drivers = DriverRegistry()
        cell = Cell.load(path, drivers)
        files = drivers.controller_files(cell.name, cell.addresses["robot"], cell.surroundings("robot", WallClock()))
        (tmp_path / "cellctl.script").write_text(script(files["cellctl.script"]))
        simulated = await SimulatedCell.start(cell, None, None)
        try:
            clock = await simulated.clock()
            address, around = simulated.address("robot"), cell.surroundings("robot", clock, simulated.state)
            robot, second = (drivers.open("robot", address, around) for _ in range(2))
            try:
                yield RobotOnWire(robot, second, clock, simulated)
            finally:
                await robot.close()
                await clock.aclose()
        finally:
            simulated.stop()

    def run(work, simulate="", query="?contact_input=0", series="cb3", script=str, connect=True):
        async def bounded():
            async with asyncio.timeout(PATIENCE_S), opened(simulate, query, series, script) as wire:
                if connect:
                    wire.identity = await wire.robot.connect()
                return await work(wire)

        return asyncio.run(bounded())

    return run


TYPES = ("DOUBLE", *("VECTOR6D",) * 3, "INT32", "INT32", "UINT32", "UINT64", *("INT32",) * 6)
PERIOD_S = 0.002


def sample(cycle, recipe=1, joint=0.0):
    """A data package of that cycle of a robot that stands."""
    values = (100.0 + cycle * PERIOD_S, *(joint,) * 18, 7, 1, 2, 0, 0, 0, 0, 0, 0, 0)
    return packed(Kind.DATA, struct.pack(">Bd18diiIQ6i", recipe, *values))


class Bytes:
    """A server that agrees as a controller does, and then sends `sent`."""

    def __init__(self, sent, version=(5, 12, 4, 0), answers=None):
        self._sent, self._version, self._answers = sent, version, answers or {}
        self.server = None

    async def converse(self, reader, writer):
        try:
            while True:
                length, kind = struct.unpack(">HB", await reader.readexactly(3))
                content = await reader.readexactly(length - 3)
                writer.write(self._answers.get(kind) or self._answer(kind, content))
                if kind == Kind.START:
                    writer.write(self._sent)
        except (OSError, asyncio.IncompleteReadError):
            pass
        finally:
            writer.close()

    def _answer(self, kind, content):
        if kind == Kind.CONTROLLER_VERSION:
            return packed(kind, struct.pack(">4I", *self._version))
        if kind == Kind.OUTPUTS:
            return packed(kind, b"\x01" + ",".join(TYPES).encode())
        if kind == Kind.INPUTS:
            return packed(kind, b"\x01" + ",".join("INT32" for _ in content.split(b",")).encode())
        return packed(kind, b"\x01") if kind != Kind.DATA else b""


@pytest.fixture(scope="session")
def against():
    """Runs `work(line)` on an RTDE line to a server that sends these bytes."""
    assert len(TYPES) == len(OUTPUTS)

    def run(sent, work, **settings):
        async def bounded():
            server = await asyncio.start_server(Bytes(sent, **settings).converse, "127.0.0.1", 0)
            line = RtdeLine("robot", server.sockets[0].getsockname()[:2], WallClock())
            async with asyncio.timeout(PATIENCE_S):
                try:
                    await line.open()
                    return await work(line)
                finally:
                    await line.close()
                    server.close()

        return asyncio.run(bounded())

    return run
