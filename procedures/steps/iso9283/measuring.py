"""Measures a visit to one of the five points."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from cellctl.devices import TableRobot
from cellctl.procedure import StepContext, step
from procedures.steps.iso9283.plans import CubePose
from procedures.steps.iso9283.rows import IsoPoseRow, When
from procedures.steps.tracker.measuring import (
    NEAR_SHARE,
    NEEDS,
    USES,
    Measured,
    PointInputs,
    approach,
    measured_fields,
    measured_plate,
)
from procedures.steps.tracker.pointing import NestsDisagree, NotSettled


class VisitInputs(PointInputs):
    """A planned visit, the share of axis speed of transfers, percent, how many reflectors, and the table that counts.

    table: id of the table of whose rows the visit is one; None: nominal joints.
    """

    pose: CubePose
    table: str | None = None
    reflectors: Annotated[int, Field(ge=1, le=8)] = 3
    transfer_percent: Annotated[float, Field(gt=0, le=100)] = 20.0


@step(
    "iso9283.measure",
    needs={**NEEDS, "robot": TableRobot},
    uses=USES,
    errors=(NotSettled, NestsDisagree),
    title="measuring the five points",
)
async def measure(context: StepContext, inputs: VisitInputs) -> Measured:
    """Go to a point by its approach, by nominal joints or by its row of the table; measure the reflectors."""
    from procedures.steps.table_push import require_in_force

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
