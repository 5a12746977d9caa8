"""A simulated cell's robot under on-line correction, and the truth of where it brings the TCP."""

from __future__ import annotations

from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import final

import numpy as np

from cellctl.clock import Clock
from cellctl.devices import CorrectionModel
from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.formats.online import CorrectionFile
from cellctl.kinematics import Floats
from cellctl.operations.cell_devices import SimulatedCell, open_devices, tell_targets
from drivers.kuka_rsi.robot.kuka_robot import KukaRobot
from sims.cell import read_cell
from sims.world import World
from tests.helpers.runs import ROOT

HEAVY_CELL = ROOT / "procedures" / "papers" / "cells" / "heavy_robot_cell.yaml"


@final
@dataclass(frozen=True)
class Bench:
    """The robot's driver, connected; the simulators; the cell's time."""

    robot: KukaRobot
    simulated: SimulatedCell
    clock: Clock

    async def keep(self, number: int, every_ms: int, joints: Sequence[Sequence[float]]) -> None:
        """Write a program of its own onto the controller."""
        steps = [list(map(float, row)) for row in joints]
        message = {"op": "own_program", "device": "robot", "number": number, "every_ms": every_ms, "joints": steps}
        with self.clock.standing():
            await self.simulated.tell(message)


@asynccontextmanager
async def simulated_robot(cell_file: Path, seed: int = 1, clock: str | None = None) -> AsyncIterator[Bench]:
    """The robot of a cell file, connected to its simulators."""
    simulated = await SimulatedCell.start(Cell.load(cell_file, DriverRegistry()), seed, clock, ())
    try:
        async with robot_of(cell_file, simulated) as bench:
            yield bench
    finally:
        simulated.stop()


@asynccontextmanager
async def robot_of(cell_file: Path, simulated: SimulatedCell) -> AsyncIterator[Bench]:
    """The robot of a cell file, connected to simulators that run already."""
    cell, time = Cell.load(cell_file, DriverRegistry()), await simulated.clock()
    devices = open_devices(cell, DriverRegistry(), time, simulated, ["robot"])
    robot = devices["robot"]
    assert isinstance(robot, KukaRobot)
    try:
        await robot.connect()
        await tell_targets(simulated, devices, time)
        yield Bench(robot, simulated, time)
    finally:
        await robot.close()
        await time.aclose()


def correction_model(file: CorrectionFile) -> CorrectionModel:
    """As a driver takes it."""
    return CorrectionModel(file.id, {name: tuple(values) for name, values in file.arrays.items()})


def true_world(cell_file: Path, seed: int) -> World:
    """The simulated robot of a cell and seed."""
    cell = read_cell(cell_file)
    return World(replace(cell, simulate=replace(cell.simulate, seed=seed)), seed)


def true_places(world: World, joints: Sequence[Sequence[float]]) -> Floats:
    """The TCP (N, 3), mm, in the robot's base frame, at actual readings (N, n), deg, without scatter."""
    return np.array([world.tcp(list(row), (0.0, 0.0, 0.0)) for row in joints])
