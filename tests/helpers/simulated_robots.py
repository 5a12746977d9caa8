"""A simulated cell's robot as the engine opens it: with drives on a CAN bus, and under on-line correction.

`true_places` tells where the correction brings the TCP. `there_and_back` is what an engine does in tests of faults in
mid-correction. A `WatchedCell` runs in a thread of the test and keeps the true joints of every cycle.

A `TcpPath` is a path of the controller's own program: how far is the true TCP from the nominal path? The task of the
RSI process answers the simulated controller's telegrams in this process; its time stands still meanwhile, so that the
World tells where the TCP truly is at every telegram.
"""

from __future__ import annotations

import csv
import itertools
import json
import os
import select
import threading
from collections.abc import AsyncIterator, Iterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager, contextmanager
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, final
from unittest.mock import patch

import numpy as np

import cellctl
import sims.running
from cellctl.clock import Clock
from cellctl.devices import CorrectionModel, Device
from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.formats import ModelFile
from cellctl.formats.online import CorrectionFile
from cellctl.formats.table_making import nominal_chain
from cellctl.kinematics import Floats, inverse
from cellctl.operations.cell_devices import SimulatedCell, open_devices, tell_targets
from drivers.kuka_rsi.cyclic.limits import OnlineLimits
from drivers.kuka_rsi.cyclic.online_block import pack
from drivers.kuka_rsi.cyclic.online_correction import OnlineCorrection
from drivers.kuka_rsi.cyclic.online_model import OnlineModel
from drivers.kuka_rsi.cyclic.session import Admission, SearchOrder
from drivers.kuka_rsi.cyclic.shared_block import SharedBlock
from drivers.kuka_rsi.cyclic.telegram import read_telegram
from drivers.kuka_rsi.robot.kuka_robot import KukaRobot
from sims.cell import read_cell
from sims.running import RunningCell
from sims.world import World
from tests.helpers.krc import wavy_model
from tests.helpers.runs import ROOT

CELLS = Path(__file__).parents[2] / "procedures" / "cells"
HOME = (0.0, -90.0, 90.0, 0.0, 45.0, 0.0)
ROBOT = f"kuka+rsi://192.168.10.2:49152?ethernet={CELLS}/rsi_ethernet.xml&eki=172.31.1.147:54600"
DRIVES = "canopen+socketcan://can0?bitrate=1000000&nodes=1,2,3,4,5,6"

HEAVY_CELL = ROOT / "procedures" / "papers" / "cells" / "heavy_robot_cell.yaml"

MODEL = CorrectionModel("m1", {name: tuple(values) for name, values in wavy_model(0.5, span_deg=170.0).items()})
HERE, THERE = (5.0, -65.0, 95.0, 5.0, 65.0, 5.0), (15.0, -60.0, 90.0, 15.0, 75.0, -15.0)
PERCENT = 4.0

CYCLE_NS = 4_000_000
PATIENCE_S = 60.0
_STANDS_CYCLES = 75

STEP_MS = 12
LIMITS = OnlineLimits(online_correction_deg=1.5)
_ACCELERATION_MM_S2 = 1000.0
_CENTRE = np.array([2000.0, 200.0, 0.0])
_ROBOT = ROOT / "procedures" / "papers" / "robots" / "kr300_with_end_effector.yaml"
_POSES = ROOT / "procedures" / "papers" / "targets" / "heavy_robot.csv"


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


async def corrected_from_here(robot: KukaRobot) -> None:
    """Bring it to HERE, and switch the correction on."""
    await robot.move(HERE, 50)
    await robot.correction_on(MODEL)


async def there_and_back(robot: KukaRobot) -> None:
    """Until something stops it."""
    for target in (THERE, HERE) * 20:
        await robot.move(target, PERCENT)


@final
class WatchedCell:
    """`joints`: the robot's true joints, deg, one row each `CYCLE_NS` of the cell's time."""

    def __init__(self, cell_file: Path) -> None:
        scenes: list[Any] = []

        def keep(*arguments: Any, **named: Any) -> Any:
            scenes.append(_SCENE(*arguments, **named))
            return scenes[-1]

        with patch.object(sims.running, "Scene", keep):
            self.cell = RunningCell(read_cell(cell_file), wait_for_host=True)
        (self._scene,) = scenes
        self.joints: list[tuple[float, ...]] = []
        self._keep()
        self._thread = threading.Thread(target=self.cell.run, daemon=True)
        self._thread.start()

    def seen_from(self) -> SimulatedCell:
        """As the drivers of a cell address it."""
        return SimulatedCell(None, None, self.cell.ready)  # type: ignore[arg-type] - no process of its own

    def let_pass(self, seconds: float) -> None:
        """Until so much of the cell's time has gone by."""
        passed = threading.Event()
        self.cell.kernel.at(self.cell.kernel.now + round(seconds * 1e9), passed.set)
        assert passed.wait(PATIENCE_S)

    def close(self) -> None:
        self.cell.kernel.stop()
        self._thread.join(PATIENCE_S)
        assert not self._thread.is_alive()
        self.cell.close()

    def largest_step(self) -> float:
        """Of any axis from one cycle to the next, deg."""
        pairs = itertools.pairwise(self.joints)
        return max(abs(b - a) for before, after in pairs for a, b in zip(before, after, strict=True))

    def held(self) -> bool:
        """Whether the robot has stood for the last 0.3 s."""
        last = self.joints[-_STANDS_CYCLES:]
        return len(set(last)) == 1

    def _keep(self) -> None:
        kernel = self.cell.kernel
        self.joints.append(tuple(self._scene.arm.joints_at(kernel.now)[0]))
        kernel.at(kernel.now + CYCLE_NS, self._keep)


_SCENE = sims.running.Scene


@contextmanager
def watched_cell(cell_file: Path) -> Iterator[WatchedCell]:
    """The simulators of a cell file in lockstep."""
    watched = WatchedCell(cell_file)
    try:
        yield watched
    finally:
        watched.close()


@asynccontextmanager
async def watched_robot(cell_file: Path) -> AsyncIterator[tuple[Bench, WatchedCell]]:
    """The robot of a cell file, connected to simulators that are watched."""
    with watched_cell(cell_file) as watched:
        async with robot_of(cell_file, watched.seen_from()) as bench:
            yield bench, watched


@cache
def identified(seed: int = 1) -> ModelFile:
    """The heavy robot of a seed, identified from the true places of the paper's poses."""
    poses = _poses()
    true = true_places(true_world(HEAVY_CELL, seed), poses)
    columns = {f"A{axis}": poses[:, axis - 1] for axis in range(1, 7)} | {
        name: true[:, i] for i, name in enumerate("XYZ")
    }
    return cellctl.fit(_ROBOT, columns, model="geometry+compliance+harmonics", folds=2).file


def _poses() -> Floats:
    rows = [row for row in csv.DictReader(_POSES.open()) if row["set"] == "fit"]
    return np.array([[float(row[f"A{axis}"]) for axis in range(1, 7)] for row in rows])[:160]


def outline(shape: str) -> Floats:
    """The points (N, 2), mm, of a circle of 150 mm radius, or of a U of 300 mm with rounded corners, 1 mm apart."""
    if shape == "circle":
        angle = np.linspace(0.0, 2.0 * np.pi, 943)
        return 150.0 * np.column_stack([np.cos(angle) - 1.0, np.sin(angle)])
    turn = np.linspace(0.0, np.pi / 2, 64)
    corner = 40.0 * np.column_stack([np.sin(turn), 1.0 - np.cos(turn)])
    down = np.column_stack([np.linspace(0.0, 260.0, 261), np.zeros(261)])
    across = np.column_stack([np.full(221, 300.0), np.linspace(40.0, 260.0, 221)])
    first = down[-1] + corner
    second = across[-1] + np.column_stack([corner[:, 1] * -1.0, corner[:, 0]])
    up = np.column_stack([np.linspace(260.0, 0.0, 261), np.full(261, 300.0)])
    return np.concatenate([down, first[1:], across[1:], second[1:], up[1:]])


@final
@dataclass(frozen=True, eq=False)
class TcpPath:
    """A path: joints (N, 6), deg, in steps of `STEP_MS`, and the nominal TCP along it (M, 3), mm, model's frame."""

    joints: Floats
    places: Floats

    @classmethod
    def of(cls, shape: str, speed_mm_s: float, model: ModelFile) -> TcpPath:
        """At a speed, from standstill to standstill, in the y–z plane before the robot, the orientation held."""
        chain, joints = nominal_chain(model), model.robot.joint_map()
        poses = joints.model(_poses())
        first = poses[np.argmin(np.linalg.norm(chain.forward(poses)[:, :3, 3] - _CENTRE, axis=1))]
        points = outline(shape)
        length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        gone = _gone(length[-1], speed_mm_s)
        targets = np.tile(chain.forward(first), (len(gone), 1, 1))
        base = chain.base_now[:3, :3]
        targets[:, :3, 3] += np.interp(gone, length, points[:, 0])[:, None] * base[:, 2]
        targets[:, :3, 3] += np.interp(gone, length, points[:, 1])[:, None] * base[:, 1]
        found = inverse(chain, targets, np.tile(first, (len(gone), 1)))
        assert found.converged.all()
        return cls(joints.readings(found.q), targets[:, :3, 3])


def _gone(length: float, speed: float) -> Floats:
    """Way in each step: the speed rises and falls as half a cosine."""
    ramp_s = np.pi * speed / (2.0 * _ACCELERATION_MM_S2)
    total_s = length / speed + ramp_s
    time = np.arange(0.0, total_s + STEP_MS / 1000, STEP_MS / 1000)

    def begun(t: Floats) -> Floats:
        t = np.clip(t, 0.0, None)
        rising = speed * (t - ramp_s / np.pi * np.sin(np.pi * t / ramp_s)) / 2.0
        return np.where(t < ramp_s, rising, speed * (t - ramp_s / 2.0))

    return np.where(time < total_s / 2, begun(time), length - begun(total_s - time))


@final
@dataclass(frozen=True, eq=False)
class Travelled:
    """N telegrams on the way: time (N,), s; true TCP (N, 3), mm, in the model's frame; programmed and actual joints
    (N, 6), deg.
    """

    time: Floats
    places: Floats
    programmed: Floats
    joints: Floats

    def deviation(self, path: TcpPath) -> Floats:
        """Distance (N,) of the true TCP from the nominal path, mm."""
        start, along = path.places[:-1], np.diff(path.places, axis=0)
        keep = np.linalg.norm(along, axis=1) > 1e-6
        start, along = start[keep], along[keep]
        away = self.places[:, None] - start
        share = np.clip(np.sum(away * along, axis=2) / np.sum(along**2, axis=1), 0.0, 1.0)
        return np.asarray(np.linalg.norm(away - share[..., None] * along, axis=2).min(axis=1))


@final
@dataclass(frozen=True, slots=True)
class Lag:
    """By how much the correction in effect lags behind the model's: ms, and the greatest shift of the TCP by it, mm."""

    ms: float
    mm: float


def lag_of(way: Travelled, model: ModelFile) -> Lag:
    """The delay that explains best the correction in effect, by least squares over 0 … 80 ms."""
    correction = OnlineModel(pack(CorrectionFile.of(model).arrays))
    for _ in range(3):
        correction.correction(way.programmed[0].tolist())
    wanted = np.array([correction.correction(row.tolist()) for row in way.programmed])
    actual = way.joints - way.programmed
    delays = np.arange(0.0, 0.08, 0.001)
    late = [np.stack([np.interp(way.time - each, way.time, axis) for axis in wanted.T], axis=1) for each in delays]
    best = int(np.argmin([np.sum((actual - each) ** 2) for each in late]))
    chain, joints = nominal_chain(model), model.robot.joint_map()
    ends = [chain.forward(joints.model(way.programmed + each))[:, :3, 3] for each in (wanted, actual)]
    return Lag(1000.0 * delays[best], float(np.linalg.norm(ends[0] - ends[1], axis=1).max()))


def travel(pc: Any, path: TcpPath, model: ModelFile, *, corrected: bool) -> Travelled:
    """Run `path` as the own program of the controller on the bench `pc`, RSI on, with the correction or with none."""
    pc.krc.take_program({"number": 1, "every_ms": STEP_MS, "joints": path.joints.tolist()})
    assert pc.ptp(path.joints[0], 50.0)[1] == 0
    block, memory = SharedBlock.create()
    os.close(memory)
    if corrected:
        block.online.place_model(pack(CorrectionFile.of(model).arrays))
    task = OnlineCorrection(SearchOrder(1, tuple(path.joints[0]), (0.0,) * 6, 1.0, (0,) * 8), LIMITS, block.online)
    pc.put('<Cmd Id="8" Op="CORRON"></Cmd>')
    _answer(pc, task, lambda seen, replies: seen >= 1000)
    pc.put('<Cmd Id="9" Op="OWN"><Row N="1"/></Cmd>')
    rows = _answer(pc, task, lambda seen, replies: 'Id="9"' in replies)
    pc.put('<Cmd Id="10" Op="HALT"></Cmd>')
    _answer(pc, task, lambda seen, replies: 'Id="10"' in replies)
    pc.stream = b""
    time, places, programmed, joints = (np.array(column) for column in zip(*rows, strict=True))
    return Travelled(time, places, programmed, joints)


def _answer(pc: Any, task: OnlineCorrection, done: Any) -> list[tuple[float, Any, Any, Any]]:
    """Answer telegrams until `done(telegrams, documents)`; time, true TCP, programmed and actual joints of each."""
    rows: list[tuple[float, Any, Any, Any]] = []
    pc.stream = b""
    while not done(len(rows), "".join(part for part in pc.stream.decode().split("<Stat") if "<Rep" in part)):
        ready, _, _ = select.select([pc.udp, pc.tcp], [], [], 60.0)
        assert ready, "neither telegram nor reply"
        if pc.tcp in ready:
            pc.stream += pc.tcp.recv(65536)
        if pc.udp in ready:
            text = pc.telegram()
            telegram, now = read_telegram(text.encode()), pc.kernel.now
            assert task.admit(telegram) is Admission.ANSWERABLE
            rows.append((now * 1e-9, pc.scene.arm.tcp(now), telegram.programmed, telegram.joints))
            correction, _ = task.answer(telegram, now, False, [0] * 8)
            pc.answer(text, correction)
    return rows
