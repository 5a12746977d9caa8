"""Touches in batches: what is known after each, whether it is enough, and which touches are next."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from statistics import median
from typing import Annotated

import numpy as np
from pydantic import Field

from cellctl.formats import RobotFile, artefact_of
from cellctl.planning import BestTouches, PlannedTouch
from cellctl.planning.stopping import Limits, Progress, ended_by
from cellctl.procedure import StepContext, StepInputs, StepResult, step
from cellctl.records import BatchRow
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

_PAUSE = 10.0
"""A gap between two touches longer than this many times the median was a pause, or the run was resumed after it."""


class NextBatchInputs(StepInputs):
    """batch: its number. goal_mm, most (touches of the fit), minutes (0: any), gain_percent: what ends the campaign.
    size: touches of a batch. held_out: of the campaign; a half of them follows the last batch. reference: the touch to
    return to after each `reference_every` touches, and after each smaller batch; 0: never.
    """

    batch: Annotated[int, Field(ge=0)]
    goal_mm: Annotated[float, Field(ge=0)]
    size: Annotated[int, Field(ge=1)]
    most: Annotated[int, Field(ge=5)]
    minutes: Annotated[float, Field(ge=0)] = 0.0
    gain_percent: Annotated[float, Field(ge=0, lt=100)] = 2.0
    held_out: Annotated[int, Field(ge=0)] = 0
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
    done = context.recorded(BatchRow)
    if done and done[-1].ended:
        return NextBatch(touches=[], ended=done[-1].ended)
    row, touches = await context.clock.compute(_after_batch, context, inputs)
    await context.record(row)
    context.say(row.sentence)
    return NextBatch(touches=touches, ended=row.ended)


def _after_batch(context: StepContext, inputs: NextBatchInputs) -> tuple[BatchRow, list[TouchPlan]]:
    choice = TouchModel(
        RobotFile.load(context.robot_file), artefact_of(context.cell, ("artefact",)), "auto", inputs.use_distances
    )
    known = Known.of(context.recorded(TouchRow), choice, drift_of(context))
    limits = Limits(inputs.goal_mm, inputs.most, 60.0 * inputs.minutes, inputs.gain_percent / 100.0)
    seconds, of_each = _seconds(context)
    now, size = known.error.now, min(inputs.size, inputs.most - len(known.touches))
    at = Progress(
        rows=len(known.touches),
        high_mm=now.high_mm,
        next_mm=0.0,
        next_seconds=seconds + of_each * (size + inputs.held_out // 2),
        doubt=known.doubt,
    )
    ended, next_mm, to_goal = ended_by(limits, at), None, None
    planned = [] if ended else _planned(context, inputs, known, size)
    if planned:
        made, coming = known.rows_with([touch for touch in planned if touch.chosen])
        next_mm = known.error.after(coming).high_mm
        to_goal = known.error.rows_to(limits.goal_mm, np.concatenate([made, coming]), limits.rows - at.rows)
        ended = ended_by(limits, replace(at, next_mm=next_mm))
    row = BatchRow(
        noun="touches",
        rows=at.rows,
        most=limits.rows,
        goal_mm=limits.goal_mm,
        low_mm=now.low_mm,
        median_mm=now.median_mm,
        high_mm=now.high_mm,
        next_mm=next_mm,
        to_goal=to_goal,
        seconds=round(seconds, 3),
        model=known.found.result.model,
        doubt=known.doubt,
        ended=ended or "",
    )
    if ended:
        planned = _held_out(context, inputs)
    first = 1 + last_number(context, TouchRow, ReferenceRow)
    again = inputs.reference.number
    plans = [as_plan(first + place, each, "test" if ended else "fit", again) for place, each in enumerate(planned)]
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
    spheres, count = spheres_named(context, names_of(inputs.spheres)), inputs.held_out // 2
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


def _seconds(context: StepContext) -> tuple[float, float]:
    """What the touches so far took on the cell's clock, without pauses; and one of them."""
    rows = sorted([*context.recorded(TouchRow), *context.recorded(ReferenceRow)], key=lambda row: row.number)
    gaps = [1e-9 * (after.time_ns - before.time_ns) for before, after in pairwise(rows)]
    usual = median(gap for gap in gaps if gap > 0.0)
    worked = [gap for gap in gaps if 0.0 < gap < _PAUSE * usual]
    return sum(worked), usual
