"""The steps of a daily check: what this run measured, what earlier runs measured, and the verdict."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from cellctl.procedure import NoInputs, StepContext, StepInputs, StepResult, step
from procedures.steps.daily._verdict import day_points, judged, read_earlier_runs
from procedures.steps.daily.rows import DailyPointsRow, DailyVerdict
from procedures.steps.judged import Judged


class CollectInputs(StepInputs):
    """The name of the baseline that this run belongs to."""

    baseline: Annotated[str, Field(min_length=1)] = "first"


@step("daily.collect")
async def collect(context: StepContext, inputs: CollectInputs) -> None:
    """Collect the measured points and nests; refuse a run in which the station moved."""
    await context.record(DailyPointsRow(day=await context.clock.compute(day_points, context, inputs.baseline)))


class Earlier(StepResult):
    """How many earlier runs can be compared."""

    runs: int


@step("daily.earlier_runs", reads_files=True)
async def earlier_runs(context: StepContext, inputs: NoInputs) -> Earlier:
    """Read the earlier runs of this check from the folder of runs, and record what they measured."""
    row = await context.clock.compute(read_earlier_runs, context)
    await context.record(row)
    for why in sorted({reason for _, reason in row.left_out}):
        count = sum(reason == why for _, reason in row.left_out)
        context.say(f"{count} earlier runs are not compared: {why}")
    return Earlier(runs=len(row.runs))


class JudgeInputs(StepInputs):
    """baseline_runs: the first runs, which are the baseline. false_alarm: probability per run and chart. weight: λ of
    the EWMA.
    """

    baseline_runs: Annotated[int, Field(ge=20)] = 20
    false_alarm: Annotated[float, Field(ge=1e-4, le=0.2)] = 0.0027
    weight: Annotated[float, Field(ge=0.05, le=1)] = 0.2


@step("daily.judge", verdict=DailyVerdict)
async def judge(context: StepContext, inputs: JudgeInputs) -> Judged:
    """Compare the points with the baseline by T² and EWMA; before the baseline is complete, only count it."""
    verdict, chart = await context.clock.compute(judged, context, inputs)
    if chart:
        await context.record(chart)
    await context.record(verdict)
    return Judged.of(verdict)
