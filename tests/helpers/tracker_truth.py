"""What the instrument of a tracker campaign would have shown without noise: the simulated world's truth, for tests."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import final

import numpy as np

from cellctl.formats import RobotFile
from cellctl.journal import RunState
from cellctl.kinematics import Floats
from cellctl.metrology.axis_frames import AxisFrames, Turn, axis_frames
from cellctl.metrology.measured_pose import MeasuredPose
from cellctl.metrology.points import LEAST_MM, Points
from cellctl.records import ResidualsRow
from procedures.steps.tracker.circles import AXES
from procedures.steps.tracker.reflectors import points_of
from procedures.steps.tracker.rows import PoseRow, TurnRow, VisitedRow
from sims.cell import SimCell, read_cell
from sims.geocom._accuracy import ARCSEC, PROFILES, set_up_of
from sims.geocom._address import profile_of
from sims.geocom._optics import AxisErrors, direction_of, levelled, point_at, tilt_of, to_instrument
from sims.world import World
from sims.world.true_places import TrueReflectors, TrueStation

FLEXIBLE = ("compliance", "gear", "backlash", "expansion", "warm_up")
"""Effects of the robot that `simulate: errors:` can switch on, none of them in `geometry`."""

NO_SCATTER = (0.0, 0.0, 0.0)


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
