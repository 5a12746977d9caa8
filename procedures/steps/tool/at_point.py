"""The tool from poses at a fixed point, to which the operator moves the tip by hand."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from cellctl.devices import JointReader
from cellctl.procedure import NoInputs, StepContext, StepInputs, StepResult, step
from procedures.steps.tool.on_sphere import Solved
from procedures.steps.tool.rows import ToolPoseRow, ToolVerdict


class PoseInputs(StepInputs):
    """The number of the pose, from 0."""

    number: Annotated[int, Field(ge=0)]


class ReadPose(StepResult):
    """The joint readings, degrees."""

    joints: list[float]


@step("tool.read_pose", needs={"robot": JointReader}, title="reading the joints")
async def read_pose(context: StepContext, inputs: PoseInputs) -> ReadPose:
    """Read the joints with the tip at the fixed point; nothing moves."""
    robot: JointReader = context.device("robot")
    joints = tuple(round(value, 6) for value in await robot.joints())
    await context.record(ToolPoseRow(number=inputs.number, joints=joints))
    return ReadPose(joints=list(joints))


@step("tool.solve_poses", verdict=ToolVerdict, title="solving for the tool")
async def solve_poses(context: StepContext, inputs: NoInputs) -> Solved:
    """Find tool and point from the poses, judge the tool on each pose by the others, write `tool.yaml`."""
    from procedures.steps.tool.solving import record_solution, tool_of_poses

    return await record_solution(context, await context.clock.compute(tool_of_poses, context))
