"""Short tracker campaigns over the wires, their ends at the command line, and the simulated world's truth of them.

`Truth` is what the instrument would have shown without noise. `Verified` is a run of `compensate_and_verify` with its
floor: the errors of a predictor that knows the truth.
"""

from __future__ import annotations

import asyncio
import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, final

import numpy as np
import pytest

from cellctl.cli.run_progress import exit_of, show_end
from cellctl.engine import Mailbox, NobodyWatching, Outcome
from cellctl.formats import RobotFile
from cellctl.journal import RunState, fold, read_journal
from cellctl.kinematics import Floats
from cellctl.metrology.axis_frames import AxisFrames, Turn, axis_frames
from cellctl.metrology.error_figures import FloorRatio, floor_ratio
from cellctl.metrology.measured_points import LEAST_MM, Points
from cellctl.metrology.measured_pose import MeasuredPose
from cellctl.operations.campaign import load_campaign
from cellctl.operations.cell_devices import SimulatedCell
from cellctl.operations.launch import Options, ResumedRun, result_of, resumed_run, run_on
from cellctl.records import ResidualsRow, TableStateRow
from procedures.steps.tracker._verdict import Targets
from procedures.steps.tracker.circles import AXES
from procedures.steps.tracker.reflectors import points_of
from procedures.steps.tracker.rows import CompensatedRow, PoseRow, TargetsRow, TrackerVerdict, TurnRow, VisitedRow
from sims.cell import SimCell, read_cell
from sims.geocom._accuracy import ARCSEC, PROFILES, profile_of, set_up_of
from sims.geocom._optics import AxisErrors, direction_of, levelled, point_at, tilt_of, to_instrument
from sims.world import World
from sims.world.true_places import TrueReflectors, TrueStation
from tests.helpers.runs import ROOT, Ended, faults, finished_run, quick_cell, run_here

PROCEDURE = ROOT / "procedures" / "tracker_calibration.yaml"
CELL = ROOT / "procedures" / "cells" / "tracker_cell.yaml"
FEW = {
    "poses_fit": 24,
    "poses_test": 8,
    "monuments_every": 20,
    "turn_points": 5,
    "samples": 2,
    "model": "geometry",
    "warm_up_minutes": 0.05,
    "warm_up_limit": 2,
    "transfer_speed": 50,
}

FLEXIBLE = ("compliance", "gear", "backlash", "expansion", "warm_up")
"""Effects of the robot that `simulate: errors:` can switch on, none of them in `geometry`."""
NO_SCATTER = (0.0, 0.0, 0.0)

HEAVY_CELL = ROOT / "procedures" / "papers" / "cells" / "heavy_robot_cell.yaml"
CALIBRATION = ROOT / "procedures" / "papers" / "configuration_space_kriging.yaml"
TARGETS = HEAVY_CELL.parents[1] / "targets" / "heavy_robot.csv"
"""The poses of the paper's task workspace; its set `test` is in no fit."""
MOST_MM, OVER_FLOOR = 0.15, 1.15
"""Demands on iterated methods: largest error, and RMS divided by the floor's."""


def procedure_of(folder: Path, **values: object) -> Path:
    """The shipped procedure with other defaults."""
    text = PROCEDURE.read_text()
    for name, value in (FEW | values).items():
        before, mark, rest = text.partition(f"  {name}: {{")
        assert mark, name
        line, _, after = rest.partition("\n")
        head, _, tail = line.partition("default: ")
        text = f"{before}{mark}{head}default: {value},{tail.partition(',')[2]}\n{after}"
    path = folder / "tracker_calibration.yaml"
    path.write_text(text.replace("cells/tracker_cell.yaml", str(CELL)))
    return path


def cell_of(folder: Path, simulate: str = "", name: str = "cell.yaml") -> Path:
    """A quick copy of the shipped cell with lines added to its `simulate:` section."""
    return quick_cell(folder, simulate, shipped=CELL, name=name)


def run(folder: Path, *settings: str, meanwhile: Any = None, **values: object) -> Ended:
    """The campaign with few poses and these faults."""
    cell = cell_of(folder, faults(*settings) if settings else "")
    return run_here(procedure_of(folder, **values), cell, folder, meanwhile=meanwhile)


def verdict_of(ended: Ended) -> TrackerVerdict:
    """The campaign's verdict."""
    found = ended.journal.last(TrackerVerdict)
    assert found is not None, ended.outcome.error
    return found


@dataclass(frozen=True)
class Told:
    """What the command line tells at the end of a run: exit code and stderr."""

    exit: int
    stderr: str


def told(ended: Ended, folder: Path, capsys: pytest.CaptureFixture[str]) -> Told:
    """Of a run that ended in `folder`."""
    capsys.readouterr()
    show_end(ended.outcome, result_of(folder / "run", ended.outcome, 0.0), folder / "run", quiet=True)
    return Told(int(exit_of(ended.outcome)), capsys.readouterr().err)


def assert_ended_safely(ended: Ended) -> None:
    """The robot is held, no table is in force, and the journal has an end and no step that is left open."""
    assert ended.outcome.held
    assert ended.robot_is_held()
    assert ended.outcome.troubles == ()
    assert ended.journal.ended is not None
    assert not ended.journal.in_flight
    assert not ended.journal.uncertain
    tables = ended.journal.recorded(TableStateRow)
    assert not tables or tables[-1].active is False


def assert_resumable(folder: Path) -> None:
    """`--resume` accepts the run, without a person's acknowledgement."""
    assert _to_resume(folder).state.finished


def _to_resume(folder: Path) -> ResumedRun:
    campaign = load_campaign(folder / "tracker_calibration.yaml", folder / "cell.yaml", [], resumed=True)
    return resumed_run(campaign, folder, folder / "run", [], acknowledged=False)


def run_and_resume(folder: Path, meanwhile: Any, **values: object) -> tuple[Outcome, Outcome, RunState]:
    """The campaign until a fault of `meanwhile` ends it, then resumed on the same cell; both ends, and the journal."""
    procedure, cell, run = procedure_of(folder, **values), cell_of(folder), folder / "run"

    async def go() -> tuple[Outcome, Outcome, RunState]:
        campaign = load_campaign(procedure, cell, [])
        simulated = await SimulatedCell.start(campaign.cell, None, None, ())
        try:
            mailbox = Mailbox()
            options = Options(None, None)
            first = asyncio.create_task(run_on(simulated, campaign, options, run, mailbox, NobodyWatching()))
            await meanwhile(mailbox, simulated)
            ended, again = await first, await asyncio.to_thread(_to_resume, folder)
            options = Options(again.seed, again.clock, resumed=again.state)
            finished = await run_on(simulated, again.campaign, options, run, Mailbox(), NobodyWatching())
        finally:
            simulated.stop()
        return ended, finished, fold(read_journal(run))

    return asyncio.run(go())


def started(journal: RunState, step: str) -> bool:
    """Whether a step whose path begins so was begun."""
    return any(path.startswith(step) for path in journal.steps)


@final
class Truth:
    """The cell of one seed, robot and instrument. switched_off: effects that are left out of this truth."""

    def __init__(self, cell_file: Path, seed: int, switched_off: Sequence[str] = ()) -> None:
        cell = read_cell(cell_file)
        errors = {**cell.simulate.errors, **dict.fromkeys(switched_off, 0.0)}
        self._cell: SimCell = replace(cell, simulate=replace(cell.simulate, seed=seed, errors=errors))
        assert cell.station
        assert cell.reflectors
        self._world = World(self._cell, seed)
        self._names = [one.id for one in cell.reflectors.on_flange]
        self._reflectors = TrueReflectors(cell.reflectors, seed, errors["reflector"])
        self._station = TrueStation(cell.station, self._world.up, seed, errors["station"], errors["station_drift"])
        settings = cell.simulate.settings["tracker"]
        profile = PROFILES[settings["noise"] or profile_of(cell.addresses["tracker"])]
        self._set_up = set_up_of(seed, profile, settings["noise_scale"])
        self._axes = AxisErrors(*(settings[f"{name}_arcsec"] * ARCSEC for name in ("collimation", "index")))

    def places(self, rows: Sequence[VisitedRow], *, shown: bool) -> Floats:
        """The reflector at each row (N, 3), mm, in the instrument's levelled frame at that time.

        shown: with the instrument's constant errors: zero and scale of its range, collimation and index.
        """
        return np.array([self._place(row, shown=shown) for row in rows])

    def _place(self, row: VisitedRow, *, shown: bool) -> Floats:
        time_ns = row.point.time_ns
        self._world.warm(time_ns)
        readings = self._world.links_after(row.joints, row.direction)
        target = self._reflectors.at(self._world.flange(readings, NO_SCATTER), 0.0)[self._names.index(row.reflector)]
        station = self._station.frame(self._world.ageing.on_ns(time_ns))
        xyz = levelled(tilt_of(station, self._world.up), to_instrument(station, target.xyz))
        if not shown:
            return np.array(xyz)
        read = self._axes.reading(direction_of(xyz))
        distance = float(np.linalg.norm(xyz))
        return np.array(point_at(read.hz, read.v, distance + self._set_up.shift_mm(distance)))


@final
@dataclass(frozen=True, eq=False)
class HeldOut:
    """The errors (M,) of N poses that the identification did not use, mm: of nominal, identified and true robot."""

    nominal: Floats
    identified: Floats
    floor: Floats


def held_out(run: Path, journal: RunState, truth: Truth) -> HeldOut:
    """Of a campaign with positions, in run folder `run`. The nominal robot has the best base and reflector."""
    residuals = journal.recorded(ResidualsRow)[0]
    poses = {row.number: row for row in journal.recorded(PoseRow)}
    lines = list(csv.DictReader((run / "dataset.csv").open()))
    chosen = np.array(residuals.held_out)
    rows = [poses[int(lines[line - 2]["pose"])] for line in np.array(residuals.line)[chosen]]
    before, after = (np.linalg.norm(np.array(each)[chosen], axis=1) for each in (residuals.before, residuals.after))
    measured = np.array([row.point.xyz for row in rows])
    return HeldOut(before, after, np.linalg.norm(measured - truth.places(rows, shown=True), axis=1))


def found_frames(journal: RunState, robot_file: Path) -> AxisFrames:
    """The frames {B} and {T} from the recorded turns, with full covariances."""
    rows = journal.recorded(TurnRow)
    return _frames(rows, points_of([row.point for row in rows]), robot_file)


def true_frames(journal: RunState, robot_file: Path, truth: Truth) -> AxisFrames:
    """The same from the places where the reflector truly was at the recorded joints."""
    rows = journal.recorded(TurnRow)
    return _frames(rows, Points.of(truth.places(rows, shown=False), LEAST_MM), robot_file)


def frame_errors(found: AxisFrames, true: AxisFrames) -> Mapping[str, tuple[float, float, float]]:
    """{B} and {T}: error of place (mm), of direction (deg), and NEES."""
    pairs = {"B": (found.base, true.base), "T": (found.tool, true.tool)}
    return {name: (*_error(one, other), one.nees(other.matrix)) for name, (one, other) in pairs.items()}


def _error(one: MeasuredPose, other: MeasuredPose) -> tuple[float, float]:
    turn = one.matrix[:3, :3] @ other.matrix[:3, :3].T
    angle = float(np.degrees(np.arccos(np.clip((np.trace(turn) - 1.0) / 2.0, -1.0, 1.0))))
    return float(np.linalg.norm(one.matrix[:3, 3] - other.matrix[:3, 3])), angle


def _frames(rows: Sequence[TurnRow], points: Points, robot_file: Path) -> AxisFrames:
    angles = RobotFile.load(robot_file).joint_map().model(np.array([row.joints for row in rows]))
    turned = [[number for number, row in enumerate(rows) if number and row.axis == axis] for axis in AXES]
    a1, a2, a5, a6 = (Turn(points.pick(one), angles[one, axis - 1]) for one, axis in zip(turned, AXES, strict=True))
    return axis_frames(a1, a2, a5, a6, points.pick([0]))


@final
@dataclass(frozen=True, eq=False)
class Verified:
    """3-D errors (N,), mm, of N targets: before, after, and of a predictor that knows the truth, on the rows after."""

    before: Floats
    after: Floats
    floor: Floats
    correction_deg: float
    left_out: int

    @classmethod
    def of(cls, run: Path, cell: Path, seed: int) -> Verified:
        """Of the run in a folder, on the simulated `cell` of `seed`."""
        journal: RunState = fold(read_journal(run))
        targets, made = Targets.of(journal), journal.recorded(TargetsRow)[-1]
        rows = {row.number: row for row in journal.recorded(CompensatedRow)}
        visits = [rows[int(number)] for number in targets.numbers]
        measured = np.array([row.point.xyz for row in visits])
        true = Truth(cell, seed).places(visits, shown=True)
        floor = np.linalg.norm(measured - true, axis=1)
        return cls(*targets.lengths, floor, made.max_correction_deg, len(made.left_out))

    @classmethod
    def pooled(cls, parts: Sequence[Verified]) -> Verified:
        """The targets of several runs together."""
        columns = (np.concatenate([getattr(one, name) for one in parts]) for name in ("before", "after", "floor"))
        return cls(*columns, max(one.correction_deg for one in parts), sum(one.left_out for one in parts))

    @property
    def ratio(self) -> FloorRatio:
        """RMS after, divided by the floor's."""
        return floor_ratio(self.after, self.floor)


def calibrated(seed: int, folder: Path, cell: Path = HEAVY_CELL) -> Path:
    """The run folder of a calibration of the heavy-robot cell by `auto` from the 160 poses; an earlier one serves.

    Without the step that fits eight more models to compare them: `tests/papers` runs it.
    """
    before, step, after = CALIBRATION.read_text().partition("  - id: compare\n")
    assert step, "the procedure compares no models"
    folder.mkdir(parents=True, exist_ok=True)
    procedure = folder / CALIBRATION.name
    procedure.write_text(before + after[after.index("\n\n") :])
    settings = (
        "--cell",
        cell,
        f"--set=pose_file={TARGETS}",
        "--seed",
        str(seed),
        "--set",
        "poses_test=6",
        "--set",
        "model=auto",
    )
    return finished_run(folder / f"calibrated-{seed}", procedure, *settings)


def verified(
    seed: int,
    model_run: Path,
    folder: Path,
    method: str,
    passes: int = 0,
    targets: int = 80,
    cell: Path = HEAVY_CELL,
) -> Path:
    """The run folder of `compensate_and_verify` by `method`; an earlier one serves. passes: 0: until it converges."""
    settings = {
        "model_run": model_run,
        "target_file": TARGETS,
        "targets": targets,
        "method": method,
        "passes": passes,
        "two_face_limit": 0.2,
    }
    given = [part for name, value in settings.items() for part in ("--set", f"{name}={value}")]
    runs = folder / f"{method}-{passes or 'iterated'}-{seed}"
    return finished_run(runs, "compensate_and_verify", "--cell", cell, "--seed", str(seed), *given)
