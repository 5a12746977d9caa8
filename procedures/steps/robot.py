"""Steps that use only the robot."""

from __future__ import annotations

from cellctl.devices import SearchingRobot
from cellctl.procedure import NoInputs, StepContext, step


@step("robot.stop", needs={"robot": SearchingRobot})
async def stop(context: StepContext, inputs: NoInputs) -> None:
    """Hold the robot where it is."""
    robot: SearchingRobot = context.device("robot")
    await robot.stop()
