"""The steps of a test by ISO 9283: model, cube and table before it, visits to the five points, figures and verdict."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field

from cellctl.devices import TableRobot, TableStore
from cellctl.procedure import CellContext, NoInputs, StepContext, StepInputs, StepResult, step
from procedures.steps.iso9283 import CycleInputs, PlanInputs
from procedures.steps.iso9283._evaluation import evaluated, station_row, verdict_of
from procedures.steps.iso9283.planning import CubePose, CubeRound, compensated, cube_rounds, cube_row, planned
from procedures.steps.iso9283.rows import IsoPoseRow, IsoVerdict, When
from procedures.steps.judged import Judged, PushInputs
from procedures.steps.table_push import push_of_run, require_in_force, withdrawn_unless_better
from procedures.steps.tracker.measuring import (
    NEAR_SHARE,
    NEEDS,
    USES,
    Measured,
    NotSettled,
    PointInputs,
    approach,
    measured_fields,
    measured_plate,
)
from procedures.steps.tracker.model_files import check_model, read_model_of
from procedures.steps.tracker.reflectors import NestsDisagree
from procedures.steps.tracker.rows import MODEL_FILE, ReadModelRow


class ReadInputs(StepInputs):
    """Folder of the run whose model compensates, or its name beside this run; empty: none."""

    run: str = ""


class ReadModel(StepResult):
    """Whether there is a model."""

    found: bool


def _check_model(context: CellContext, known: Mapping[str, Any]) -> None:
    check_model(context, known)


@step("iso9283.read_model", check=_check_model, reads_files=True)
async def read_model(context: StepContext, inputs: ReadInputs) -> ReadModel:
    """Read the model that an earlier run identified, and record it; refuse that of another controller."""
    if inputs.run:
        await context.record(await context.clock.compute(read_model_of, context, inputs.run))
    else:
        context.say("no model is given: the robot is measured by nominal joints only")
    return ReadModel(found=bool(inputs.run))


class Planned(StepResult):
    """The cycles by nominal joints, in rounds."""

    rounds: list[CubeRound]


def _check_plan(context: CellContext, known: Mapping[str, Any]) -> None:
    if {"edge", "centre", "reflectors"} <= known.keys():
        planned(context, known["edge"], known["centre"], known["reflectors"])


@step("iso9283.plan", check=_check_plan)
async def plan(context: StepContext, inputs: PlanInputs) -> Planned:
    """Find the ISO cube in the workspace, the reflectors visible at its five points, and plan the cycles."""
    cube = await context.clock.compute(planned, context, inputs.edge, inputs.centre, inputs.reflectors)
    await context.record(cube_row(cube))
    context.say(f"cube of {cube.edge:g} mm about {', '.join(f'{x:.0f}' for x in cube.centre)} mm")
    return Planned(rounds=cube_rounds(context, cube, cube.readings, inputs, by_table=False))


class Compensation(StepResult):
    """The cycles by the table, in rounds, and the table's id; empty without a model."""

    rounds: list[CubeRound]
    table: str | None


@step("iso9283.compensate")
async def compensate(context: StepContext, inputs: CycleInputs) -> Compensation:
    """Compensate the five points by the model that was read, and write their table into the run folder."""
    models = context.recorded(ReadModelRow)
    if not models:
        return Compensation(rounds=[], table=None)
    await context.write_artefact(MODEL_FILE, models[-1].text)
    table, rounds = await context.clock.compute(compensated, context, inputs)
    await context.write_artefact("table.json", table.text())
    context.say(f"five points compensated by the model of {models[-1].run}, up to {table.max_correction_deg:.3f}°")
    return Compensation(rounds=rounds, table=table.id)


@step("iso9283.register")
async def register(context: StepContext, inputs: NoInputs) -> None:
    """Find the instrument's place from the registration poses, which are not judged."""
    await context.record(await context.clock.compute(station_row, context))


@step("iso9283.push", needs={"robot": TableStore})
async def push(context: StepContext, inputs: PushInputs) -> None:
    """Push the table of the five points; to be done again on resume (`on_resume: always`)."""
    if inputs.table is not None and not context.recorded(IsoVerdict):
        await push_of_run(context, inputs.table)


class VisitInputs(PointInputs):
    """A planned visit, the share of axis speed of transfers, percent, how many reflectors, and the table that counts.

    table: id of the table of whose rows the visit is one; None: nominal joints.
    """

    pose: CubePose
    table: str | None = None
    reflectors: Annotated[int, Field(ge=1, le=8)] = 3
    transfer_percent: Annotated[float, Field(gt=0, le=100)] = 20.0


@step("iso9283.measure", needs={**NEEDS, "robot": TableRobot}, uses=USES, errors=(NotSettled, NestsDisagree))
async def measure(context: StepContext, inputs: VisitInputs) -> Measured:
    """Go to a point by its approach, by nominal joints or by its row of the table; measure the reflectors."""
    pose, near = inputs.pose, inputs.transfer_percent * NEAR_SHARE
    robot: TableRobot = context.device("robot")
    await approach(robot, pose, inputs.transfer_percent)
    if pose.row is None:
        joints = await robot.move(tuple(pose.joints), near)
    else:
        await require_in_force(robot, inputs.table or "")
        joints = await robot.move_to_row(pose.row, near)
    fields: dict[str, Any] = await measured_fields(context, pose, joints, inputs.settling)
    others = await measured_plate(context, fields, inputs.reflectors, inputs.settling) if inputs.reflectors > 1 else ()
    when: When = "before" if pose.row is None else "after"
    row = IsoPoseRow(**fields, when=when, cycle=pose.cycle, place=pose.place, side=pose.side, others=others)
    await context.record(row)
    return Measured(xyz=list(fields["point"].xyz))


@step("iso9283.evaluate")
async def evaluate(context: StepContext, inputs: NoInputs) -> None:
    """Register the base on the registration poses, and compute AP, RP, vAP, AD and RD before and after."""
    registration, rows = await context.clock.compute(evaluated, context)
    for row in (registration, *rows):
        await context.record(row)


class JudgeInputs(StepInputs):
    """transfer_percent: share of axis speed of transfers; reflectors: at each pose."""

    transfer_percent: Annotated[float, Field(gt=0, le=100)]
    reflectors: Annotated[int, Field(ge=1, le=8)]


@step("iso9283.judge", needs={"robot": TableStore}, verdict=IsoVerdict)
async def judge(context: StepContext, inputs: JudgeInputs) -> Judged:
    """State the figures; withdraw a table by which the five points are not better."""
    found = await context.clock.compute(verdict_of, context, inputs.transfer_percent, inputs.reflectors)
    found = await withdrawn_unless_better(context, found)
    await context.record(found)
    return Judged.of(found)
