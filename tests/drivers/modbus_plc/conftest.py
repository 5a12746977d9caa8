"""A cell with a PLC and nothing else, its simulator in a process of its own, in lockstep."""

from __future__ import annotations

import asyncio
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.operations.cell_devices import SimulatedCell

ROOT = Path(__file__).parents[3]
PATIENCE_S = 120.0

CELL = """name: plc cell
model: {root}/procedures/robots/kr5_r1400.yaml
devices: {{plc: "modbus+tcp://192.168.10.5:502?unit=1{settings}"}}
simulate:
  seed: 1
  {simulate}
"""


class PlcOnWire:
    """The driver's device, the cell's clock, and the simulator's control port."""

    def __init__(self, plc, clock, simulated):
        self.plc, self.clock, self._simulated = plc, clock, simulated

    async def fault(self, name, **settings):
        """A fault from now on."""
        with self.clock.standing():
            await self._simulated.tell({"op": "fault", "fault": name, **settings})

    async def let_pass(self, seconds):
        await self.clock.sleep(seconds)


@pytest.fixture
def on_wire(tmp_path):
    """Runs `work(wire)` on the connected PLC. `settings`: of the address; `simulate`: a line of that section."""

    @asynccontextmanager
    async def opened(settings, simulate, driver_unit):
        path = tmp_path / "cell.yaml"
        path.write_text(CELL.format(root=ROOT, settings=settings, simulate=simulate))
        drivers = DriverRegistry()
        cell = Cell.load(path, drivers)
        simulated = await SimulatedCell.start(cell, None, None)
        try:
            clock = await simulated.clock()
            address = simulated.address("plc")
            address = replace(address, query={**address.query, "unit": str(driver_unit)})
            plc = drivers.open("plc", address, cell.surroundings("plc", clock))
            try:
                yield PlcOnWire(plc, clock, simulated)
            finally:
                await plc.close()
                await clock.aclose()
        finally:
            simulated.stop()

    def run(work, settings="", simulate="", *, driver_unit=1, connect=True):
        async def bounded():
            async with asyncio.timeout(PATIENCE_S), opened(settings, simulate, driver_unit) as wire:
                if connect:
                    wire.identity = await wire.plc.connect()
                return await work(wire)

        return asyncio.run(bounded())

    return run
