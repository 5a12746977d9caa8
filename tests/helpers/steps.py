"""Steps without wires: what a step sees of a run, rows of the sphere campaign, and a tracker cell of fake devices.

`Context` has rows that all count, what the step said, and who the devices are. Rows have what a test cares about; all
else is plausible. The tracker cell has robot, instrument, PLC and drives as Python objects, in a time that leaps. Its
robot is `own_model`'s KR5 with errors, its reflectors and the instrument somewhat off the places of the cell file.
"""

from __future__ import annotations

import asyncio
import heapq
import itertools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from cellctl.clock import Clock, WallClock
from cellctl.devices import (
    ControllerTable,
    DeviceRefused,
    Health,
    Identity,
    Lock,
    MeasuredPoint,
    MotorCurrents,
    Reflector,
    TableInfo,
    TableState,
    TargetLost,
    Temperatures,
    TwoFaceError,
    Weather,
)
from cellctl.engine import Engine, Mailbox, Outcome, Plan, Surround
from cellctl.files import load_yaml, write_atomically
from cellctl.formats.cell_sections import reflectors_of, station_of
from cellctl.journal import Journal, RunResumed, RunStarted, RunState, SourceFile, fold, read_journal
from cellctl.procedure import StepRegistry, load_procedure, section_of
from cellctl.records import Figures, Row
from procedures.steps.sphere.rows import (
    DriftFigures,
    ReferenceRow,
    SphereVerdict,
    StandOffRow,
    StopFigures,
    TouchRow,
)
from tests.helpers.own_model import Floats, OwnArm, kr5, pose_of
from tests.helpers.simulated_setups import KR5_SIGNS, erroneous

CONTACT: dict[str, Any] = {
    "number": 0,
    "sphere": "S1",
    "resting": (0.1,) * 6,
    "time_ns": 1,
    "time_sigma_ns": 1,
    "tick": 1,
    "bounces": 0,
    "stop_cycles": 2,
    "late": 0,
    "lost": 0,
    "skipped": 0,
    "attempt": 1,
}
STANDOFF: dict[str, Any] = {
    **CONTACT,
    "row": None,
    **dict.fromkeys(("nominal", "commanded", "at_target", "at_contact"), (0.1,) * 6),
    "normal": (0.0, 0.0, 1.0),
    "travel_mm": 10.0,
}
HELD_OUT_SENTENCE = (
    "Error of held-out touches: 0.700 mm before, 0.030 mm after (mean of 30; max 2.000, 0.100 mm). Better than nominal."
)
VERDICT: dict[str, Any] = {
    "verdict": "better",
    "sentence": HELD_OUT_SENTENCE,
    "before": Figures(0.7, 0.9, 2.0),
    "after": Figures(0.03, 0.04, 0.1),
    "model": {"n_fit": 50},
    "drift": DriftFigures(1, 0.0, 0.01, 0.0, False, 0.0, False),
    "stops": StopFigures(0.17, 0.19, 2, 0, 0, 0),
    "noise_scale": 1.25,
}

PROCEDURES = Path(__file__).parents[2] / "procedures"
CELL = PROCEDURES / "cells" / "tracker_cell.yaml"
ROBOT = PROCEDURES / "robots" / "kr5_r1400.yaml"


@dataclass
class Context:
    """A step's view of a run in which every row counts."""

    rows: list[Row] = field(default_factory=list)
    run_folder: Path = Path()
    robot: Any = None
    serial: str = "SIM-1"
    run_name: str = "run"
    operator: str = "Ada"
    robot_file: Path = Path()
    cell: Any = None
    said: list[str] = field(default_factory=list)
    clock: Clock = field(default_factory=WallClock)

    def device(self, name: str) -> Any:
        return self.robot

    def identity(self, name: str) -> Identity:
        return Identity(name, self.serial, "KR5", "KSS", self.serial.startswith("SIM-"))

    async def record(self, row: Row) -> None:
        self.rows.append(row)

    async def write_artefact(self, name: str, content: str) -> None:
        write_atomically(self.run_folder / name, content)

    def artefact(self, name: str) -> Path:
        return self.run_folder / name

    def recorded(self, *kinds: type[Row]) -> list[Any]:
        of = {kind.KIND: kind for kind in kinds}
        return [of[row.KIND].read(row.data()) for row in self.rows if row.KIND in of]

    all_recorded = recorded

    def say(self, text: str) -> None:
        self.said.append(text)


def touch(**fields: Any) -> TouchRow:
    return TouchRow(**{**CONTACT, "set": "fit", "joints": (0.1,) * 6, **fields})


def reference(shift_mm: float, sigma_mm: float) -> ReferenceRow:
    row = touch(set="reference").data()
    return ReferenceRow(**row, repeats=0, after_touch=1, shift_mm=shift_mm, sigma_mm=sigma_mm)


def standoff(**fields: Any) -> StandOffRow:
    return StandOffRow(**{**STANDOFF, **fields})


def sphere_verdict(**fields: Any) -> SphereVerdict:
    return SphereVerdict(**{**VERDICT, **fields})


class LeapingClock(Clock):
    """Time that leaps to the next timer whenever the loop has nothing to do and no thread works."""

    source = "leaping"

    def __init__(self) -> None:
        self._now_ns = 0
        self._standing = 0
        self._timers: list[tuple[int, int, Any]] = []
        self._order = itertools.count()

    def now_ns(self) -> int:
        return self._now_ns

    def call_later(self, seconds: float, callback: Callable[[], object]) -> Any:
        timer = _Timer(callback)
        heapq.heappush(self._timers, (self._now_ns + round(seconds * 1e9), next(self._order), timer))
        return timer

    @contextmanager
    def standing(self) -> Iterator[None]:
        self._standing += 1
        try:
            yield
        finally:
            self._standing -= 1

    async def leap(self) -> None:
        """Run for ever beside the work."""
        ready = asyncio.get_running_loop()._ready
        while True:
            await asyncio.sleep(0)
            if ready:
                continue
            if self._standing or not self._timers:
                await asyncio.sleep(0.001)
                continue
            due, _, timer = heapq.heappop(self._timers)
            if timer.live:
                self._now_ns = max(self._now_ns, due)
                timer.callback()


class _Timer:
    def __init__(self, callback: Callable[[], object]) -> None:
        self.callback, self.live = callback, True

    def cancel(self) -> None:
        self.live = False


@dataclass
class Truth:
    """What is true in the cell: the arm, its joints (readings, deg), reflectors and nests, and the instrument."""

    arm: OwnArm
    joints: Floats
    on_flange: dict[str, Floats]
    facing: dict[str, Floats]
    nests: dict[str, Floats]
    station: Floats
    rng: np.random.Generator
    constant_mm: float = 0.0
    repeatability_mm: float = 0.02
    scatter: Floats = field(default_factory=lambda: np.zeros(3))

    @classmethod
    def of(cls, seed: int, errors: float = 1.0) -> Truth:
        rng = np.random.default_rng([seed, 77])
        document = load_yaml(CELL)
        station, reflectors = station_of(document), reflectors_of(document)
        nominal = kr5()
        arm = erroneous(rng, nominal, nominal.link_names) if errors else nominal
        turn = Rotation.from_euler("ZYX", station.abc, degrees=True)
        off = Rotation.from_rotvec([0.0, 0.0, np.radians(rng.normal(0.0, 0.2))])
        nests = {nest.id: np.array(nest.xyz, float) for nest in station.nests}
        for distance in station.distances:  # as certified
            a, b = (nests[name] for name in distance.between)
            nests[distance.between[1]] = a + (b - a) / np.linalg.norm(b - a) * distance.mm
        return cls(
            arm=arm,
            joints=np.array([0.0, -90.0, 90.0, 0.0, 45.0, 0.0]),
            on_flange={one.id: np.array(one.xyz) + rng.normal(0.0, 0.5, 3) for one in reflectors.on_flange},
            facing={one.id: np.array(one.facing, float) for one in reflectors.on_flange},
            nests=nests,
            station=pose_of(off * turn, np.array(station.xyz) + rng.normal(0.0, 6.0, 3)),
            rng=rng,
        )

    def flange(self) -> Floats:
        return self.arm.flange(KR5_SIGNS * np.radians([self.joints]))[0]

    def targets(self) -> dict[str, tuple[Floats, Floats]]:
        """Place and facing (unit) of every reflector in the base frame."""
        flange, own = self.flange(), self.station[:3, 3]
        found = {
            name: (flange[:3, :3] @ place + flange[:3, 3], flange[:3, :3] @ self.facing[name])
            for name, place in self.on_flange.items()
        }
        for name, place in self.nests.items():
            found[name] = (place, (own - place) / np.linalg.norm(own - place))
        return found

    def seen(self, base_place: Floats) -> Floats:
        return np.asarray(self.station[:3, :3].T @ (base_place - self.station[:3, 3]))

    def bump(self, mm: float) -> None:
        """Shift the instrument."""
        self.station = self.station.copy()
        self.station[:3, 3] += mm / np.sqrt(3.0)


class FakeDevice:
    def __init__(self, name: str, truth: Truth, clock: LeapingClock) -> None:
        self.name, self.truth, self.clock = name, truth, clock

    async def connect(self) -> Identity:
        return Identity(self.name, "SIM-1", "fake", "1", simulated=True)

    async def health(self) -> Health:
        return Health(True, "well")

    async def stop(self) -> None: ...

    async def close(self) -> None: ...


class FakeRobot(FakeDevice):
    """Moves at once; keeps tables."""

    axes = 6

    def __init__(self, name: str, truth: Truth, clock: LeapingClock) -> None:
        super().__init__(name, truth, clock)
        self.tables: list[ControllerTable] = []
        self.moves: list[tuple[float, ...]] = []

    async def joints(self) -> tuple[float, ...]:
        return tuple(self.truth.joints.tolist())

    async def move(self, target: tuple[float, ...], speed_percent: float) -> tuple[float, ...]:
        await self.clock.sleep(float(np.abs(np.array(target) - self.truth.joints).max()) / speed_percent + 0.2)
        self.truth.joints = np.array(target, float)
        self.truth.scatter = self.truth.rng.normal(0.0, self.truth.repeatability_mm / np.sqrt(3.0), 3)
        self.moves.append(target)
        return target

    async def push_table(self, table: ControllerTable) -> TableState:
        self.tables.append(table)
        return await self.table_state()

    async def table_state(self) -> TableState:
        infos = [TableInfo(table.id, len(table.rows), "sum") for table in self.tables[::-1]]
        return TableState(infos[0] if infos else None, infos[1] if infos[1:] else None, None)

    async def read_table(self) -> ControllerTable | None:
        return self.tables[-1] if self.tables else None

    async def rollback_table(self) -> TableState:
        if not self.tables:
            raise DeviceRefused(self.name, "no table")
        self.tables.pop()
        return await self.table_state()

    async def move_to_row(self, row: int, speed_percent: float) -> tuple[float, ...]:
        return await self.move(tuple(self.tables[-1].rows[row - 1].compensated), speed_percent)


@dataclass
class Faults:
    """What goes wrong: aims (by count, from 1) that find no reflector (`lost`), or the one before (`twice`); a bump,
    mm, before an aim (`bump_at`).
    """

    lost: set[int] = field(default_factory=set)
    twice: set[int] = field(default_factory=set)
    bump_at: dict[int, float] = field(default_factory=dict)
    unlevelled: bool = False
    two_face_mm: float = 0.02


class FakeTracker(FakeDevice):
    """Finds the nearest reflector within the window, and measures it with noise."""

    def __init__(self, name: str, truth: Truth, clock: LeapingClock, faults: Faults) -> None:
        super().__init__(name, truth, clock)
        self.faults = faults
        self.aims = 0
        self.initialised = 0
        self.weather: Weather | None = None
        self.target = ""

    async def initialise(self, reflector: Reflector) -> None:
        self.initialised += 1

    async def set_weather(self, weather: Weather) -> None:
        self.weather = weather

    async def aim(self, place: tuple[float, float, float], search_mm: float) -> None:
        self.aims += 1
        await self.clock.sleep(1.5)
        self.truth.bump(self.faults.bump_at.get(self.aims, 0.0))
        if self.aims in self.faults.lost:
            raise TargetLost(self.name, "the beam is broken", "clear the line of sight, then go on")
        found = []
        for name, (where, facing) in self.truth.targets().items():
            beam = self.truth.station[:3, 3] - where
            seen = facing @ beam / np.linalg.norm(beam) > np.cos(np.radians(30.0))
            distance = float(np.linalg.norm(self.truth.seen(where) - place))
            if seen and distance < search_mm * 1.2:
                found.append((distance, name))
        if not found:
            raise TargetLost(self.name, f"no reflector within {search_mm:g} mm of {place}", "look")
        if self.aims not in self.faults.twice:
            self.target = min(found)[1]

    async def lock(self) -> Lock:
        return Lock.LOCKED if self.target else Lock.NONE

    async def measure(self, samples: int, *, faces: int = 1) -> MeasuredPoint:
        await self.clock.sleep(1.0 * samples)
        truth = self.truth
        true = truth.seen(truth.targets()[self.target][0])
        if self.target in truth.on_flange:
            true = true + truth.scatter
        distance = float(np.linalg.norm(true))
        beam = true / distance
        along, across = 0.05 / np.sqrt(samples), 0.01
        spread = along**2 * np.outer(beam, beam) + across**2 * (np.eye(3) - np.outer(beam, beam))
        xyz = truth.rng.multivariate_normal(true + truth.constant_mm * beam, spread)
        common = 0.1**2 * np.outer(beam, beam)
        rows = lambda matrix: tuple(map(tuple, matrix.tolist()))  # noqa: E731
        return MeasuredPoint(
            xyz=tuple(xyz.tolist()),
            covariance=rows(spread + common),
            common=rows(common),
            samples=samples,
            scatter=(0.05, 0.01, 0.01),
            faces=faces,
            hz_rad=0.0,
            v_rad=0.0,
            range_mm=distance,
            time_ns=self.clock.now_ns(),
            device_ms=0,
            levelled=True,
            weather=self.weather,
            accuracy="fake",
            noise_only=False,
        )

    async def two_face_error(self, samples: int) -> TwoFaceError:
        return TwoFaceError(1e-6, 1e-6, 0.0, self.faults.two_face_mm, 0.0)

    async def levelled(self) -> bool:
        return not self.faults.unlevelled


class FakePlc(FakeDevice):
    """Everything in order."""

    def conditions(self) -> dict[str, str]:
        return {"emergency_stop_ok": "", "guard_closed": ""}

    async def holds(self, condition: str) -> bool:
        return True

    async def inputs(self) -> dict[str, bool]:
        return dict.fromkeys(self.conditions(), True)

    async def set_output(self, name: str, value: bool) -> None: ...

    async def temperatures(self) -> Temperatures:
        return Temperatures(20.0, 25.0, 22.0, 20.0, self.clock.now_ns())

    async def weather(self) -> Weather:
        return Weather(20.0, 1013.25, 50.0)


class FakeDrives(FakeDevice):
    """Constant currents."""

    async def currents(self, samples: int) -> MotorCurrents:
        return MotorCurrents((0.1,) * 6, (0.01,) * 6, samples, self.clock.now_ns())


@dataclass
class FakeRun:
    """A campaign that has ended on fake devices."""

    outcome: Outcome
    journal: RunState
    robot: FakeRobot
    tracker: FakeTracker
    folder: Path


def run_fake(
    procedure: Path,
    folder: Path,
    parameters: dict[str, Any] | None = None,
    *,
    seed: int = 1,
    faults: Faults | None = None,
    truth: Truth | None = None,
    cell: Path = CELL,
    resumed: FakeRun | None = None,
    name: str = "run",
    began: str = "now",
    kind: type[FakeRobot] = FakeRobot,
) -> FakeRun:
    """Run a procedure on fake devices, in the folder `name`; began: its calendar time; kind: of the robot.

    resumed: continue this run, which has ended, with its robot where it was.
    """

    async def go() -> FakeRun:
        clock = LeapingClock()
        true = resumed.robot.truth if resumed else truth or Truth.of(seed)
        loaded = load_procedure(procedure)
        assert loaded.problems == (), loaded.problems
        values = {one.name: one.default for one in loaded.parameters.values()} | (parameters or {})
        robot, tracker = kind("robot", true, clock), FakeTracker("tracker", true, clock, faults or Faults())
        devices: dict[str, Any] = {
            "robot": robot,
            "tracker": tracker,
            "plc": FakePlc("plc", true, clock),
            "drives": FakeDrives("drives", true, clock),
        }
        file, run, registry = SourceFile("x.yaml", "", ""), folder / name, StepRegistry.installed()
        if resumed:
            robot.tables = resumed.robot.tables
            journal, record = Journal.reopen(run, clock.now_ns), fold(read_journal(run))
            record.apply(journal.append(RunResumed("me", "now", "", {}, True)))
        else:
            journal, record = Journal.create(run, clock.now_ns), RunState()
            section = section_of(loaded, registry)
            started = RunStarted(file, file, values, seed, "lockstep", "me", began, "", {}, name=name, section=section)
            record.apply(journal.append(started))
        surround = Surround(clock, seed, run, load_yaml(cell), ROBOT, devices)
        plan = Plan(loaded, values, registry, devices)
        leaping = asyncio.create_task(clock.leap())
        outcome = await Engine(plan, surround, journal, Mailbox(), record=record).run()
        leaping.cancel()
        journal.close()
        return FakeRun(outcome, record, robot, tracker, run)

    return asyncio.run(go())
