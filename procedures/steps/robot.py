"""Steps that use only the robot."""

from __future__ import annotations

from cellctl.devices import Device
from cellctl.procedure import NoInputs, StepContext, step


@step("robot.stop", needs={"robot": Device})
async def stop(context: StepContext, inputs: NoInputs) -> None:
    """Hold the robot where it is."""
    robot: Device = context.device("robot")
    await robot.stop()
