"""Poses in batches: what is known after each, whether it is enough, and which poses are next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Self, final

import numpy as np
from pydantic import Field

from cellctl.calibration import FitResult, fit
from cellctl.formats import DataSet, Measurements, ModelChoice, RobotFile, measurements, postures_of
from cellctl.kinematics import Floats
from cellctl.planning import (
    Counts,
    MeasuringArm,
    MeasuringPoses,
    Reach,
    Sight,
    measuring_postures,
    plan_given_poses,
)
from cellctl.procedure import StepContext, StepResult, step
from cellctl.records import BatchRow
from procedures.steps.batch_inputs import BatchInputs
from procedures.steps.batches import Forecast, Task, after_batch, best_next, next_rows, rows_in_sigma
from procedures.steps.identified import held_out_split
from procedures.steps.tracker.identification import kind_of, numbered, pose_records
from procedures.steps.tracker.pose_choice import CANDIDATES_EACH, postures_within, rows_at
from procedures.steps.tracker.pose_planning import enough_in_reach, pose_limits, pose_seed, rounds_of
from procedures.steps.tracker.pose_plans import ModelInputs, Round
from procedures.steps.tracker.rows import NestRow, PoseRow, ReturnRow
from procedures.steps.tracker.station import base_from_instrument


class NextRoundInputs(BatchInputs, ModelInputs):
    """monuments_every: poses between two visits to the nests. from_both: share of poses measured from both sides."""

    monuments_every: Annotated[int, Field(ge=5)] = 30
    from_both: Annotated[float, Field(ge=0, le=1)] = 0.15


class NextRound(StepResult):
    """The poses of the batch; after the last one those that are held out, then none. ended: why, or empty."""

    rounds: list[Round]
    ended: str


@step("tracker.next_round")
async def next_round(context: StepContext, inputs: NextRoundInputs) -> NextRound:
    """Identify the robot from the poses of the fit so far, predict its error, and end the campaign or plan on.

    Held-out poses take no part in it.
    """
    rounds, ended = await next_rows(context, _after_batch, inputs)
    return NextRound(rounds=rounds, ended=ended)


def _after_batch(context: StepContext, inputs: NextRoundInputs) -> tuple[BatchRow, list[Round]]:
    poses, planner = context.recorded(PoseRow), _Planner.of(context, inputs)
    known = KnownPoses.of(context, poses, inputs.model)

    def plan(size: int) -> tuple[list[Round], Floats, Floats]:
        visits = planner.best(known, size)
        return planner.rounds(visits), *known.rows_with(visits)

    row, rounds = after_batch("poses", inputs, known.forecast, _times(context, poses), plan)
    if row.ended and inputs.held_out_at_last:
        rounds = planner.rounds(planner.held_out(known, inputs.held_out_at_last))
    return row, rounds


def _times(context: StepContext, poses: Sequence[PoseRow]) -> list[int]:
    """Of all points since the first pose: poses, returns and nests."""
    first = min(row.point.time_ns for row in poses)
    between = [row.point for row in context.recorded(ReturnRow)] + [row.point for row in context.recorded(NestRow)]
    return [point.time_ns for point in (*(row.point for row in poses), *between) if point.time_ns >= first]


@final
@dataclass(frozen=True, eq=False)
class KnownPoses:
    """A fit of poses, and the error that it predicts over a task. records: their rows of the data set; postures (P, n):
    commanded, deg, each once.
    """

    robot: RobotFile
    model: ModelChoice
    task: Task
    postures: Floats
    records: list[dict[str, Any]]
    measured: Measurements
    result: FitResult
    forecast: Forecast

    @classmethod
    def of(cls, context: StepContext, every: Sequence[PoseRow], model: ModelChoice) -> Self:
        """From all poses so far; held-out ones only say where the robot's error counts."""
        robot, poses = RobotFile.load(context.robot_file), [row for row in every if row.set == "fit"]
        postures = np.array(list(dict.fromkeys(row.commanded for row in poses)))
        records = pose_records(context, poses)
        measured = _measured(robot, model, records)
        result = fit(measured.task, held_out_split(measured))
        task = Task.of(((row.set, row.commanded) for row in every), robot.joint_map())
        forecast = Forecast.of(len(postures), measured.task, result, task, each=len(poses) / len(postures))
        return cls(robot, model, task, postures, records, measured, result, forecast)

    def rows_with(self, visits: MeasuringPoses) -> tuple[Floats, Floats]:
        """Jacobians (N, k, P), (M, k, P) of the poses that were measured and of those that are planned, in their
        standard deviations, by the identified robot. Those that are planned are measured like the last one.
        """
        sides = zip(visits.readings.tolist(), visits.side.tolist(), strict=True)
        coming = [{**self.records[-1], **numbered("A", joints), **numbered("D", side)} for joints, side in sides]
        measured = _measured(self.robot, self.model, [*self.records, *coming])
        planned = np.array(measured.lines) > max(self.measured.lines)
        rows = rows_in_sigma(measured.task, self.result)
        return rows[~planned], rows[planned]


def _measured(robot: RobotFile, model: ModelChoice, records: Sequence[dict[str, Any]]) -> Measurements:
    data = DataSet.of_records(records, "dataset.csv")
    return measurements(robot, data, measure=kind_of(data), model=model)


@final
@dataclass(frozen=True, eq=False)
class _Planner:
    """Plans the poses of a batch; number: of its first visit."""

    context: StepContext
    inputs: NextRoundInputs
    arm: MeasuringArm
    reach: Reach
    sight: Sight
    number: int

    @classmethod
    def of(cls, context: StepContext, inputs: NextRoundInputs) -> Self:
        """From what is known of robot, cell and station now."""
        robot = RobotFile.load(context.robot_file)
        home = np.array(postures_of(context.cell, robot, "turn").home)
        reach, sight, options = pose_limits(context, 1, base_from_instrument(context))
        arm = MeasuringArm(robot.chain().with_base(np.eye(4)), robot.joint_map(), sight, home, options)
        number = 1 + max(row.number for kind in (PoseRow, ReturnRow) for row in context.recorded(kind))
        return cls(context, inputs, arm, reach, sight, number)

    def best(self, known: KnownPoses, count: int) -> MeasuringPoses:
        """Visits to the best `count` postures after those that are known, a share of them from both sides."""
        seed = pose_seed(self.context, f"batch {self.inputs.batch}")
        with enough_in_reach(self.context):
            candidates = measuring_postures(self.arm, self.reach, CANDIDATES_EACH * count, seed)
        task = rows_at(known.robot, np.concatenate([known.postures, candidates]), self.sight.reflectors)
        chosen = candidates[best_next(task, len(known.postures), known.task, count)]
        return self._visits(known.robot, Counts(count, 0, 0, self.inputs.from_both), seed, chosen)

    def held_out(self, known: KnownPoses, count: int) -> MeasuringPoses:
        """Visits to postures within the joints of the fit, after all others."""
        seed = pose_seed(self.context, "held out")
        with enough_in_reach(self.context):
            postures = postures_within(known.postures, self.arm, self.reach, count, seed)
        return self._visits(known.robot, Counts(0, count, count, 0.0), seed, postures)

    def rounds(self, visits: MeasuringPoses) -> list[Round]:
        """The visits, in rounds."""
        return rounds_of(self.context, visits, self.arm.home, self.inputs.monuments_every, self.number)

    def _visits(self, robot: RobotFile, counts: Counts, seed: int, postures: Floats) -> MeasuringPoses:
        chain, joints = robot.chain(), robot.joint_map()
        return plan_given_poses(chain, joints, self.sight, counts, self.arm.home, seed, postures, self.arm.options)
