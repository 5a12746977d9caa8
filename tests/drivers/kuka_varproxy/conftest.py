"""A cell with a robot behind a variable proxy and nothing else, its simulator in a process of its own, in lockstep."""

from __future__ import annotations

import asyncio
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.operations.cell_devices import SimulatedCell

ROOT = Path(__file__).parents[3]
PATIENCE_S = 120.0

CELL = """name: proxy cell
model: {root}/procedures/robots/kr5_r1400.yaml
devices: {{robot: "kuka+varproxy://172.31.1.147:7000"}}
limits: {{robot: {{speed_percent: {percent}}}}}
postures: {{home: [0, -90, 90, 0, 45, 0]}}
simulate:
  seed: 1
  {simulate}
"""


class RobotOnWire:
    """The driver's device, a second one on the same simulator, the cell's clock and the simulator's control port."""

    def __init__(self, robot, second, clock, simulated):
        self.robot, self.second, self.clock, self._simulated = robot, second, clock, simulated
        self.identity = None

    async def fault(self, name, **settings):
        """A fault from now on, or at its event."""
        await self.tell({"op": "fault", "fault": name, **settings})

    async def tell(self, message):
        with self.clock.standing():
            await self._simulated.tell(message)


@pytest.fixture
def on_wire(tmp_path):
    """Runs `work(wire)` on the connected robot. `simulate`: a line of that section."""

    @asynccontextmanager
    async def opened(simulate, percent):
        path = tmp_path / "cell.yaml"
        path.write_text(CELL.format(root=ROOT, simulate=simulate, percent=percent))
        drivers = DriverRegistry()
        cell = Cell.load(path, drivers)
        simulated = await SimulatedCell.start(cell, None, None)
        try:
            clock = await simulated.clock()
            address, surroundings = simulated.address("robot"), cell.surroundings("robot", clock)
            robot, second = (drivers.open("robot", address, surroundings) for _ in range(2))
            try:
                yield RobotOnWire(robot, second, clock, simulated)
            finally:
                await robot.close()
                await clock.aclose()
        finally:
            simulated.stop()

    def run(work, simulate="", percent=30):
        async def bounded():
            async with asyncio.timeout(PATIENCE_S), opened(simulate, percent) as wire:
                wire.identity = await wire.robot.connect()
                return await work(wire)

        return asyncio.run(bounded())

    return run
