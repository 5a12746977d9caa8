"""The tool's measurement: touches on one sphere, or poses at a fixed point to which the operator moves the tip."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field

from cellctl.devices import ContactProbe, JointReader, SearchingRobot
from cellctl.procedure import CellContext, NoInputs, StepContext, StepInputs, StepResult, step
from procedures.steps.contact_search import FoundContact, Speeds, search_and_retreat
from procedures.steps.tool import PlanInputs
from procedures.steps.tool._solving import (
    Solved,
    ToolTouchPlan,
    check_plan,
    planned_touches,
    record_solution,
    tool_of_poses,
    tool_of_touches,
)
from procedures.steps.tool.rows import ToolPoseRow, ToolTouchRow, ToolVerdict


class ToolPlan(StepResult):
    """All touches, in order."""

    touches: list[ToolTouchPlan]


def _check_plan(context: CellContext, known: Mapping[str, Any]) -> None:
    check_plan(context, known)


@step("tool.plan", check=_check_plan)
async def plan(context: StepContext, inputs: PlanInputs) -> ToolPlan:
    """Plan touches on one sphere with several tool orientations, by ways clear of all spheres."""
    touches = await context.clock.compute(
        planned_touches, context, inputs.sphere, inputs.orientations, inputs.held_out, inputs.touches
    )
    context.say(
        f"planned {inputs.touches} touches on {inputs.sphere} with each of {inputs.orientations} tool orientations, "
        f"and of {inputs.held_out} held-out ones"
    )
    return ToolPlan(touches=touches)


class TouchInputs(StepInputs):
    """A planned touch, and its speeds: tip speed of the search, percent of axis speed for transfers."""

    touch: ToolTouchPlan
    speed_mm_s: Annotated[float, Field(gt=0, le=50)]
    transfer_percent: Annotated[float, Field(gt=0, le=100)] = 20.0


@step("tool.touch", needs={"robot": SearchingRobot, "probe": ContactProbe})
async def touch(context: StepContext, inputs: TouchInputs) -> None:
    """Go to the sphere, search along the planned line until contact, note the joints at its time, retreat."""
    robot: SearchingRobot = context.device("robot")
    planned, speeds = inputs.touch, Speeds(inputs.speed_mm_s, inputs.transfer_percent)

    async def record(found: FoundContact) -> ToolTouchRow:
        row = ToolTouchRow(
            number=planned.number,
            sphere=planned.sphere,
            set="test" if planned.set == "test" else "fit",
            orientation=planned.orientation,
            joints=tuple(round(value, 6) for value in found.joints),
            attempt=context.attempt,
            **found.row(),
        )
        await context.record(row)
        return row

    def to_start() -> Any:
        return robot.move(tuple(planned.start), speeds.near_percent)

    await search_and_retreat(robot, context.device("probe"), planned, to_start, speeds, record)


@step("tool.solve_touches", verdict=ToolVerdict)
async def solve_touches(context: StepContext, inputs: NoInputs) -> Solved:
    """Find tool and sphere centre from the touches, judge the tool on held-out orientations, write `tool.yaml`."""
    return await record_solution(context, await context.clock.compute(tool_of_touches, context))


class PoseInputs(StepInputs):
    """The number of the pose, from 0."""

    number: Annotated[int, Field(ge=0)]


class ReadPose(StepResult):
    """The joint readings, degrees."""

    joints: list[float]


@step("tool.read_pose", needs={"robot": JointReader})
async def read_pose(context: StepContext, inputs: PoseInputs) -> ReadPose:
    """Read the joints with the tip at the fixed point; nothing moves."""
    robot: JointReader = context.device("robot")
    joints = tuple(round(value, 6) for value in await robot.joints())
    await context.record(ToolPoseRow(number=inputs.number, joints=joints))
    return ReadPose(joints=list(joints))


@step("tool.solve_poses", verdict=ToolVerdict)
async def solve_poses(context: StepContext, inputs: NoInputs) -> Solved:
    """Find tool and point from the poses, judge the tool on each pose by the others, write `tool.yaml`."""
    return await record_solution(context, await context.clock.compute(tool_of_poses, context))
