"""Judges the model from the touches by poses that a tracker measured."""

from __future__ import annotations

from cellctl.procedure import NoInputs, StepContext, step
from procedures.steps.by_tracker.rows import ByTrackerVerdict
from procedures.steps.judged import Judged


@step("by_tracker.judge", verdict=ByTrackerVerdict, title="judging the model by the tracker")
async def judge(context: StepContext, inputs: NoInputs) -> Judged:
    """State how good the model from the touches is at held-out poses, beside nominal and a model from the poses."""
    from procedures.steps.by_tracker.comparison import compared

    found = await context.clock.compute(compared, context)
    await context.write_artefact("tracker.csv", found.data)
    await context.write_artefact("tracker_model.json", found.model)
    await context.record(found.poses)
    await context.record(found.verdict)
    return Judged.of(found.verdict)
