"""Identifies the robot from the measured poses."""

from __future__ import annotations

from typing import Literal

from cellctl.procedure import StepContext, StepInputs, StepResult, step
from procedures.steps.tracker.rows import TrackerVerdict


class IdentifyInputs(StepInputs):
    """Which model."""

    model: Literal["auto", "geometry"] = "auto"


class Identified(StepResult):
    """The verdict on held-out poses; 3-D distances in mm."""

    verdict: str
    sentence: str


@step("tracker.identify", verdict=TrackerVerdict, title="identifying the robot")
async def identify(context: StepContext, inputs: IdentifyInputs) -> Identified:
    """Identify the robot from the poses, state how good it was and is on the held-out ones, write data and model."""
    from procedures.steps.setup_errors import WrongSetup
    from procedures.steps.tracker.identification import identify_poses

    found = await context.clock.compute(identify_poses, context, inputs.model)
    await context.write_artefact("dataset.csv", found.data)
    if isinstance(found, WrongSetup):
        raise found.error
    await context.write_artefact("model.json", found.model)
    for row in (*found.rows, found.verdict):
        await context.record(row)
    return Identified(verdict=found.verdict.verdict, sentence=found.verdict.sentence)
