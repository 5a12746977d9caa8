"""Figures and verdict of a test."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from cellctl.devices import TableStore
from cellctl.procedure import NoInputs, StepContext, StepInputs, step
from procedures.steps.iso9283.rows import IsoVerdict
from procedures.steps.judged import Judged


@step("iso9283.evaluate", title="computing the figures")
async def evaluate(context: StepContext, inputs: NoInputs) -> None:
    """Register the base on the registration poses, and compute AP, RP, vAP, AD and RD before and after."""
    from procedures.steps.iso9283.evaluation import evaluated

    registration, rows = await context.clock.compute(evaluated, context)
    for row in (registration, *rows):
        await context.record(row)


class JudgeInputs(StepInputs):
    """transfer_percent: share of axis speed of transfers; reflectors: at each pose."""

    transfer_percent: Annotated[float, Field(gt=0, le=100)]
    reflectors: Annotated[int, Field(ge=1, le=8)]


@step("iso9283.judge", needs={"robot": TableStore}, verdict=IsoVerdict, title="judging the table")
async def judge(context: StepContext, inputs: JudgeInputs) -> Judged:
    """State the figures; withdraw a table by which the five points are not better."""
    from procedures.steps.iso9283.verdict import verdict_of
    from procedures.steps.table_push import withdrawn_unless_better

    found = await context.clock.compute(verdict_of, context, inputs.transfer_percent, inputs.reflectors)
    found = await withdrawn_unless_better(context, found)
    await context.record(found)
    return Judged.of(found)
