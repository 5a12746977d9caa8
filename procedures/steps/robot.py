"""Steps that use only the robot."""

from __future__ import annotations

from cellctl.devices import MovingRobot
from cellctl.procedure import NoInputs, StepContext, step


@step("robot.stop", needs={"robot": MovingRobot})
async def stop(context: StepContext, inputs: NoInputs) -> None:
    """Hold the robot where it is."""
    robot: MovingRobot = context.device("robot")
    await robot.stop()
