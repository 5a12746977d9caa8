"""Poses in six dimensions in the World: the poses that a campaign plans, measured by the plate on the flange."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self, final

import numpy as np
import yaml

from cellctl.calibration import FitResult, PoseRows, RobotModel, RowBlocks, Split, State, Task, fit
from cellctl.files import load_yaml
from cellctl.formats import RobotFile
from cellctl.formats.measurements import ModelTerms
from cellctl.installed import robot_file
from cellctl.kinematics import SerialChain
from cellctl.procedure._cell_check import CellFiles
from procedures.steps.tracker.plan_inputs import PlanInputs
from procedures.steps.tracker.pose_planning import planned_rounds
from sims.conditions import REFERENCE_C
from tests.studies.papers.world import Floats, PaperWorld, Ways, plate_of, pose_of_plate

ROTATION_LEVER_MM = 120.0
"""Rough size of the plate: σ of a turn is that of a point over it."""


@final
@dataclass(frozen=True, eq=False)
class Planned:
    """readings, ways (N, n): as in `PaperWorld`; held_out (N,): which poses judge."""

    readings: Floats
    ways: Ways
    held_out: Floats


@final
@dataclass(frozen=True, eq=False)
class PoseCell:
    """A cell file with an instrument, as cellctl reads it."""

    file: Path
    robot: RobotFile

    @classmethod
    def load(cls, file: Path) -> Self:
        """From the cell file."""
        return cls(file, RobotFile.load(_robot_file(file)))

    def planned(self, fit_count: int, held_out: int, seed: int) -> Planned:
        """The poses that a campaign of this seed plans, before it knows better where the instrument is."""
        context = CellFiles(load_yaml(self.file), _robot_file(self.file), seed)
        wanted = PlanInputs(fit=fit_count, held_out=held_out, reflectors=3, monuments_every=10_000, from_both=0.0)
        poses = [pose for each in planned_rounds(context, wanted, None) for pose in each.poses]
        return Planned(
            np.array([pose.joints for pose in poses]),
            np.array([pose.direction for pose in poses]),
            np.array([pose.kind == "test" for pose in poses]),
        )

    @property
    def nominal(self) -> RobotModel:
        """The robot as in its file."""
        return RobotModel(self.robot.chain())

    def angles(self, readings: Floats) -> Floats:
        """Model angles, rad."""
        return self.robot.joint_map().model(readings)


@final
@dataclass(frozen=True, eq=False)
class Poses:
    """Measured poses (N, 4, 4) of the plate (R, 3) at planned ones, in the robot's true base frame."""

    cell: PoseCell
    planned: Planned
    poses: Floats
    plate: Floats
    sigma_mm: float

    @classmethod
    def of(
        cls,
        cell: PoseCell,
        world: PaperWorld,
        planned: Planned,
        judging: PaperWorld | None = None,
        temperature_c: float = REFERENCE_C,
    ) -> Self:
        """judging, temperature_c: another state of the robot for the held-out poses."""
        seen = world.measured(planned.readings, "poses", planned.ways)
        if judging:
            other = judging.measured(planned.readings, "poses", planned.ways, temperature_c=temperature_c)
            seen = np.where(planned.held_out[:, None, None], other, seen)
        plate = plate_of(seen[~planned.held_out])
        sigma = float(np.hypot(cell.robot.repeatability / np.sqrt(3.0), 0.02))
        return cls(cell, planned, poses_of(plate, seen), plate, sigma)

    def task(self, chain: SerialChain | None = None, *, ours: bool = False) -> Task:
        """Identification of the geometry; chain: another description of the robot. ours: the rows choose effects."""
        sigma = np.tile([self.sigma_mm] * 3 + [self.sigma_mm / ROTATION_LEVER_MM] * 3, (len(self.poses), 1))
        rows = PoseRows(self.cell.angles(self.planned.readings), self.poses, sigma)
        task = Task(RobotModel(chain) if chain else self.cell.nominal, RowBlocks.of(rows))
        if not ours:
            return replace(task, groups=frozenset({"geometry", "tool"}))
        return replace(task, candidates=ModelTerms.parse("auto").candidates(self.cell.robot, rows.postures))

    def fitted(self, chain: SerialChain | None = None, *, ours: bool = False) -> FitResult:
        """The fit with its figures on the held-out poses."""
        return fit(self.task(chain, ours=ours), Split.by_column(self.planned.held_out))

    def deviations(self, state: State) -> Floats:
        """Model minus measurement (N, 6), mm and deg."""
        (block,) = self.task().rows.blocks
        assert isinstance(block, PoseRows)
        return block.deviation(state) * np.repeat([1.0, np.degrees(1.0)], 3)


def poses_of(plate: Floats, seen: Floats) -> Floats:
    """Poses (N, 4, 4) of a plate seen at (N, R, 3)."""
    return np.array([pose_of_plate(plate, one) for one in seen])


def comprehensive(deviations: Floats) -> tuple[float, float]:
    """The paper's E_p (mm) and E_a (deg) of deviations (N, 6): root of the summed squares of the axes' mean errors."""
    means = np.abs(deviations).mean(axis=0)
    return float(np.linalg.norm(means[:3])), float(np.linalg.norm(means[3:]))


def _robot_file(cell: Path) -> Path:
    """The robot file of a cell file."""
    return robot_file(yaml.safe_load(cell.read_text(encoding="utf-8"))["model"], cell.parent)
