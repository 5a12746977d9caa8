"""A simulated robot with drives on a CAN bus, opened as the engine opens it, and its faults."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cellctl.clock import Clock
from cellctl.devices import Device
from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.operations.cell_devices import SimulatedCell, open_devices, tell_targets

CELLS = Path(__file__).parents[2] / "procedures" / "cells"
HOME = (0.0, -90.0, 90.0, 0.0, 45.0, 0.0)
ROBOT = f"kuka+rsi://192.168.10.2:49152?ethernet={CELLS}/rsi_ethernet.xml&eki=172.31.1.147:54600"
DRIVES = "canopen+socketcan://can0?bitrate=1000000&nodes=1,2,3,4,5,6"


@dataclass(frozen=True)
class DriveCell:
    """A running cell; no device is connected yet."""

    devices: dict[str, Device]
    clock: Clock
    simulated: SimulatedCell

    @property
    def drives(self) -> Any:
        return self.devices["drives"]

    @property
    def robot(self) -> Any:
        return self.devices["robot"]

    async def connect(self) -> None:
        for device in self.devices.values():
            await device.connect()
        await tell_targets(self.simulated, self.devices, self.clock)

    async def fault(self, name: str, **settings: float) -> None:
        """Start a fault now."""
        with self.clock.standing():
            await self.simulated.tell({"op": "fault", "fault": name, **settings})


def cell_file(folder: Path, simulate: dict[str, Any] | None = None, devices: dict[str, str] | None = None) -> Path:
    path = folder / "drive_cell.yaml"
    content = {
        "name": "drive cell",
        "model": str(CELLS.parent / "robots/kr5_r1400.yaml"),
        "devices": devices or {"robot": ROBOT, "drives": DRIVES},
        "postures": {"home": list(HOME)},
        "simulate": simulate or {},
    }
    path.write_text(json.dumps(content))
    return path


@asynccontextmanager
async def drive_cell(path: Path) -> AsyncIterator[DriveCell]:
    registry = DriverRegistry()
    cell = Cell.load(path, registry)
    async with AsyncExitStack() as stack:
        simulated = await SimulatedCell.start(cell, None, None)
        stack.callback(simulated.stop)
        clock = await simulated.clock()
        stack.push_async_callback(clock.aclose)
        devices = open_devices(cell, registry, clock, simulated)
        for device in devices.values():
            stack.push_async_callback(device.close)
        yield DriveCell(devices, clock, simulated)
