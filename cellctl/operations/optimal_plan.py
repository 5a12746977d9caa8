"""An optimal choice of postures: rows of a fit that is still to be measured, under its whole model with its priors."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import final

import numpy as np
from numpy.typing import NDArray

from cellctl.calibration import Task
from cellctl.calibration.prediction.predict import REGION_POINTS
from cellctl.compensation.postures import stated_posture
from cellctl.files import InputError, Problem
from cellctl.formats import DataSet, ModelFile, RobotFile, from_prior, measurements
from cellctl.formats.design_problem import candidate_rows, design_problem
from cellctl.formats.measurements.columns import SIGMA_COLUMNS
from cellctl.formats.targets import read_targets
from cellctl.kinematics import Floats, abc_from_rotation
from cellctl.planning.design import CHECKED_RISE, Criterion, chosen_rows


@final
@dataclass(frozen=True)
class Aim:
    """What the rows are for. criterion: see `planning.design`. model: as for `cellctl fit`; with `prior`, a model file,
    that one's. task: CSV of targets over which the error is predicted; None: the region. sigma_mm: of the instrument on
    each axis, besides the robot's repeatability. poses: the instrument measures orientations too.
    """

    criterion: Criterion = "volume"
    model: str = "auto"
    prior: Path | None = None
    task: Path | None = None
    sigma_mm: float = 0.02
    poses: bool = False


@final
@dataclass(frozen=True, slots=True)
class DesignFigures:
    """What the chosen rows shall predict: 1 σ, 3-D, mm, RMS and largest over the task; even_…: after as many rows drawn
    evenly from the same candidates. without_one_percent: by how much the RMS rises at most without any one row, and
    leverage: mean share of a row's numbers that the fit takes from itself, both of the terms that the model has for
    certain; exchanged: number of exchanges; parameters: of the model; task: number of places.
    """

    criterion: Criterion
    sigma_mm: float
    largest_mm: float
    even_sigma_mm: float
    even_largest_mm: float
    without_one_percent: float
    leverage: float
    exchanged: int
    parameters: int
    candidates: int
    task: int

    @property
    def checkable(self) -> bool:
        """Whether every row is checked by the others."""
        return self.without_one_percent <= 100.0 * CHECKED_RISE


@final
class OptimalChoice:
    """Chooses targets among usable samples: for `TargetOptions.choose`. figures: after the choice."""

    def __init__(self, robot: RobotFile, aim: Aim) -> None:
        self._robot, self._aim = robot, aim
        self._prior = ModelFile.load(aim.prior) if aim.prior else None
        self._targets = self._readings_of(aim.task) if aim.task else None
        self.figures: DesignFigures | None = None

    def __call__(self, readings: Floats, count: int) -> NDArray[np.int_]:
        """Indices (count,) of the best of candidate readings (M, n), deg. Raises InputError."""
        problem = design_problem(self._task(readings))
        places = readings if self._targets is None else self._targets
        some = places[np.unique(np.linspace(0, len(places) - 1, REGION_POINTS).astype(int))]
        asked = problem.places(self._robot.joint_map().model(some))
        found = chosen_rows(
            problem.covariance,
            problem.candidates,
            asked,
            count,
            self._aim.criterion,
            core=problem.core,
            most_rise=CHECKED_RISE,
        )
        self.figures = DesignFigures(
            criterion=self._aim.criterion,
            sigma_mm=found.sigma_mm,
            largest_mm=found.largest_mm,
            even_sigma_mm=found.even_sigma_mm,
            even_largest_mm=found.even_largest_mm,
            without_one_percent=100.0 * float(found.rises.max(initial=0.0)),
            leverage=float(found.leverage.mean()),
            exchanged=found.exchanged,
            parameters=int(np.count_nonzero(np.diag(problem.covariance))),
            candidates=len(readings),
            task=len(some),
        )
        return np.array(found.rows)

    def _task(self, readings: Floats) -> Task:
        """A fit of the candidates as if they were measured."""
        robot = self._robot
        poses = robot.chain().forward(robot.joint_map().model(readings))
        sigma = float(np.hypot(self._aim.sigma_mm, robot.repeatability / np.sqrt(3.0)))
        columns = dict(zip("XYZ", poses[:, :3, 3].T.tolist(), strict=True))
        columns |= dict.fromkeys(SIGMA_COLUMNS, [sigma] * len(readings))
        if self._aim.poses:
            columns |= dict(zip("ABC", abc_from_rotation(poses[:, :3, :3]).T.tolist(), strict=True))
        data = candidate_rows(readings, columns)
        measured = measurements(robot, data, model=self._aim.model)
        if self._prior is not None:
            measured = from_prior(measured, self._prior, file=str(self._aim.prior))
        return measured.task

    def _readings_of(self, file: Path) -> Floats:
        """Readings (N, n), deg, in which the nominal robot reaches the targets of a file. Raises InputError."""
        robot, data = self._robot, DataSet.load(file)
        targets = read_targets(data, robot)
        chain, joints, limits = robot.chain(), robot.joint_map(), robot.limits()
        near, found, problems = limits.mean(axis=1), [], []
        for row, pose in enumerate(targets.poses):
            begin = near if targets.postures is None else targets.postures[row]
            reached = stated_posture(chain, joints, limits, pose, begin)
            if reached is None:
                problems.append(
                    Problem(str(file), targets.lines[row], 0, "is out of the robot's reach or joint limits")
                )
                continue
            found.append(reached)
            near = reached
        if not problems and len(found) < 4:
            problems.append(
                Problem(str(file), 0, 0, f"{len(found)} targets have no shape to predict", "give four or more")
            )
        if problems:
            raise InputError(problems)
        return np.array(found)
