"""The warm-up: the robot moves until its return pose settles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

from pydantic import Field

from cellctl.devices import DeviceFault, JointReadings, MovingRobot
from cellctl.formats import RobotFile, postures_of
from cellctl.metrology import Settling, SettlingLimits, settling
from cellctl.procedure import StepContext, StepResult, step
from procedures.steps.contact_search import rejoin
from procedures.steps.tracker.circles import return_pose
from procedures.steps.tracker.measuring import NEEDS, USES, NotSettled, PointInputs, measured_fields
from procedures.steps.tracker.rows import ReturnRow, WarmUpRow

_RETURNS = 6
"""Returns whose trend decides."""


class WarmUpInputs(PointInputs):
    """limit_mm: largest change of the return pose over the last six returns, and of their scatter. minutes: of motion
    between two returns. most: returns after which a robot that does not settle is refused.
    """

    limit_mm: Annotated[float, Field(gt=0)] = 0.2
    minutes: Annotated[float, Field(ge=0, le=60)] = 1.0
    most: Annotated[int, Field(ge=_RETURNS)] = 60
    transfer_percent: Annotated[float, Field(gt=0, le=100)] = 20.0


class Warm(StepResult):
    """The change of the return pose over the last returns, mm."""

    drift_mm: float


@step("tracker.warm_up", needs=NEEDS, uses=USES, errors=(NotSettled,))
async def warm_up(context: StepContext, inputs: WarmUpInputs) -> Warm:
    """Move between home and the return pose, and measure there, until the return pose settles."""
    began = context.clock.now()
    await _to_home(context, inputs.transfer_percent)
    rows: list[ReturnRow] = []
    while True:
        await _exercise(context, inputs)
        rows.append(await _return(context, inputs, len(rows)))
        found = await context.clock.compute(_judged, rows, inputs.limit_mm)
        if found.settled or len(rows) >= inputs.most:
            break
    await context.record(
        WarmUpRow(
            returns=len(rows),
            settled=found.settled,
            drift_mm=found.drift_mm,
            drift_bound_mm=found.drift_bound_mm,
            scatter_mm=found.scatter_mm,
            limit_mm=inputs.limit_mm,
            minutes=(context.clock.now() - began) / 60.0,
        )
    )
    if not found.settled:
        what = f"the return pose has not settled after {len(rows)} returns: {found.reason}"
        raise DeviceFault("robot", what, "warm up longer, or look for a loose reflector or instrument")
    context.say(
        f"warm after {len(rows)} returns: drift up to {found.drift_bound_mm:.3f} mm (limit {inputs.limit_mm:g})"
    )
    return Warm(drift_mm=found.drift_mm)


async def _to_home(context: StepContext, percent: float) -> None:
    """Home; an interrupted robot is between home and the return pose."""
    home, before, turn = _way(context)
    await rejoin(context.device("robot"), [home, before, turn, home], percent)


async def _exercise(context: StepContext, inputs: WarmUpInputs) -> None:
    """Move to and fro for the stated minutes; ends at home."""
    robot: MovingRobot = context.device("robot")
    home, before, _ = _way(context)
    until = context.clock.now() + 60.0 * inputs.minutes
    while context.clock.now() < until:
        await robot.move(before, inputs.transfer_percent)
        await robot.move(home, inputs.transfer_percent)


async def _return(context: StepContext, inputs: WarmUpInputs, number: int) -> ReturnRow:
    """Measure the return pose; ends there."""
    robot: MovingRobot = context.device("robot")
    home, before, turn = _way(context)
    pose = return_pose(context, home, number)
    await robot.move(home, inputs.transfer_percent)
    await robot.move(before, inputs.transfer_percent)
    joints = await robot.move(turn, inputs.transfer_percent)
    row = ReturnRow(**await measured_fields(context, pose, joints, inputs.settling))
    await context.record(row)
    return row


def _way(context: StepContext) -> tuple[JointReadings, JointReadings, JointReadings]:
    """Home, the approach to the return pose, the return pose."""
    home = postures_of(context.cell, RobotFile.load(context.robot_file), "turn").home
    pose = return_pose(context, home, 0)
    return tuple(home), tuple(pose.way[-1]), tuple(pose.joints)


def _judged(rows: Sequence[ReturnRow], limit_mm: float) -> Settling:
    times = [row.point.time_ns * 1e-9 for row in rows]
    limits = SettlingLimits(samples=_RETURNS, scatter_mm=limit_mm, drift_mm=limit_mm)
    return settling(times, [row.point.xyz for row in rows], limits)
