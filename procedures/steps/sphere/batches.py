"""Touches in batches: what is known after each, whether it is enough, and which touches are next."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from cellctl.formats import RobotFile, artefact_of
from cellctl.kinematics import Floats
from cellctl.planning import BestTouches, PlannedTouch
from cellctl.procedure import StepContext, StepResult, step
from cellctl.records import BatchRow
from procedures.steps.batch_inputs import BatchInputs
from procedures.steps.batches import after_batch, next_rows
from procedures.steps.sphere._identification import TouchModel
from procedures.steps.sphere._known import Known, NextTouches
from procedures.steps.sphere.plan_inputs import names_of
from procedures.steps.sphere.planning import (
    CANDIDATES_EACH,
    as_plan,
    as_touch,
    even_counts,
    plan_on,
    seed_for,
    spheres_named,
)
from procedures.steps.sphere.reference_touches import drift_of, last_number
from procedures.steps.sphere.rows import ReferenceRow, TouchRow
from procedures.steps.sphere.touch_plans import TouchPlan


class NextBatchInputs(BatchInputs):
    """reference: the touch to return to after each `reference_every` touches, and each smaller batch; 0: never."""

    spheres: str = ""
    reference: TouchPlan
    reference_every: Annotated[int, Field(ge=0)] = 0
    use_distances: bool = True


class NextBatch(StepResult):
    """The touches of the batch; after the last one those that are held out, then none. ended: why, or empty."""

    touches: list[TouchPlan]
    ended: str


@step("sphere.next_batch")
async def next_batch(context: StepContext, inputs: NextBatchInputs) -> NextBatch:
    """Identify the robot from the touches of the fit so far, predict its error, and end the campaign or plan on.

    Held-out touches take no part in it.
    """
    touches, ended = await next_rows(context, _after_batch, inputs)
    return NextBatch(touches=touches, ended=ended)


def _after_batch(context: StepContext, inputs: NextBatchInputs) -> tuple[BatchRow, list[TouchPlan]]:
    choice = TouchModel(
        RobotFile.load(context.robot_file), artefact_of(context.cell, ("artefact",)), "auto", inputs.use_distances
    )
    known = Known.of(context.recorded(TouchRow), choice, drift_of(context))
    times = [row.time_ns for row in (*context.recorded(TouchRow), *context.recorded(ReferenceRow))]

    def plan(size: int) -> tuple[list[PlannedTouch], Floats, Floats]:
        planned = _planned(context, inputs, known, size)
        return planned, *known.rows_with([touch for touch in planned if touch.chosen])

    row, planned = after_batch("touches", inputs, known.forecast, times, plan)
    if row.ended:
        planned = _held_out(context, inputs)
    first = 1 + last_number(context, TouchRow, ReferenceRow)
    again = inputs.reference.number
    plans = [as_plan(first + place, each, "test" if row.ended else "fit", again) for place, each in enumerate(planned)]
    return row, plans


def _planned(context: StepContext, inputs: NextBatchInputs, known: Known, count: int) -> list[PlannedTouch]:
    """The best `count` touches after those that are known, in a tour of their own."""
    names = tuple(sphere.id for sphere in known.choice.artefact.spheres)
    spheres = spheres_named(context, names_of(inputs.spheres))
    more = dict(zip(spheres, even_counts(CANDIDATES_EACH * count, len(spheres)), strict=True))
    choose = NextTouches(known.choice, known.task, known.touches, known.noise, names, count)
    return plan_on(
        context,
        {},
        seed_for(context, f"batch {inputs.batch}"),
        reference_every=min(inputs.reference_every, count),
        reference=as_touch(inputs.reference),
        best=BestTouches(tuple(more.get(name, 0) for name in names), choose),
    )


def _held_out(context: StepContext, inputs: NextBatchInputs) -> list[PlannedTouch]:
    """Held-out touches after all others, spread evenly."""
    spheres, count = spheres_named(context, names_of(inputs.spheres)), inputs.held_out_at_last
    if not count:
        return []
    counts = dict(zip(spheres, even_counts(count, len(spheres)), strict=True))
    return plan_on(
        context,
        counts,
        seed_for(context, "held out"),
        reference_every=min(inputs.reference_every, count),
        reference=as_touch(inputs.reference),
    )
