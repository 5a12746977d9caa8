"""Identifies the robot from the measured poses."""

from __future__ import annotations

from typing import Literal

from cellctl.procedure import StepContext, StepInputs, step
from procedures.steps.judged import Judged
from procedures.steps.tracker.rows import TrackerVerdict


class IdentifyInputs(StepInputs):
    """Which model."""

    model: Literal["auto", "geometry"] = "auto"


@step("tracker.identify", verdict=TrackerVerdict, title="identifying the robot")
async def identify(context: StepContext, inputs: IdentifyInputs) -> Judged:
    """Identify the robot from the poses, state how good it was and is on the held-out ones, write data and model."""
    from procedures.steps.identified import write_and_record
    from procedures.steps.tracker.identification import identify_poses

    return await write_and_record(context, await context.clock.compute(identify_poses, context, inputs.model))
