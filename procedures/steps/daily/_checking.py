"""The steps of a daily check: what this run measured, what earlier runs measured, and the verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Protocol

import numpy as np
from pydantic import Field

from cellctl.devices import DeviceFault
from cellctl.metrology import (
    RIGID_AND_SCALE,
    CheckLimits,
    DailyBaseline,
    daily_check,
    in_one_frame,
    rigid_and_scale,
)
from cellctl.metrology import DailyVerdict as Found
from cellctl.procedure import NoInputs, StepContext, StepInputs, StepResult, step
from procedures.steps.daily.history import finished_checks
from procedures.steps.daily.rows import (
    ControlChartRow,
    DailyFigures,
    DailyPointsRow,
    DailyVerdict,
    DayPoints,
    EarlierRun,
    EarlierRunsRow,
    Matrix,
)
from procedures.steps.judged import Judged
from procedures.steps.tracker.reflectors import points_of
from procedures.steps.tracker.rows import NestRow, PoseRow, SetUpRow
from procedures.steps.tracker.station import Sessions


def day_points(context: StepContext, baseline: str) -> DayPoints:
    """Points and nests of this run; a nest is the mean of its visits.

    Raises DeviceFault if the station moved in the run.
    """
    rows = sorted(context.recorded(PoseRow), key=lambda row: row.number)
    sessions = Sessions.of(context)
    if any(sessions.session(row.visit) != sessions.first for row in rows):
        what = "its station moved between the first and the last visit to the nests: the points cannot be compared"
        raise DeviceFault("tracker", what, "stand the instrument firmly, then run the check again")
    nests: dict[str, list[NestRow]] = {}
    for row in context.recorded(NestRow):
        nests.setdefault(row.nest, []).append(row)
    found = [points_of([row.point for row in visits]) for visits in nests.values()]
    setup = context.recorded(SetUpRow)[-1]
    return DayPoints(
        baseline=baseline,
        robot=context.identity("robot").serial,
        payload_kg=setup.payload_kg,
        accuracy=rows[0].point.accuracy,
        commanded=tuple(row.commanded for row in rows),
        points=tuple(row.point.xyz for row in rows),
        nest_names=tuple(nests),
        nests=_rows([each.xyz.mean(axis=0) for each in found]),
        spread=tuple(_rows(each.alone.mean(axis=0) / len(each)) for each in found),
    )


def _rows(values: object) -> Matrix:
    return tuple(tuple(row) for row in np.asarray(values, float).tolist())


def read_earlier_runs(context: StepContext) -> EarlierRunsRow:
    """The finished runs with the same baseline in the folder of this run, oldest first. Changes nothing there."""
    day, own = context.recorded(DailyPointsRow)[-1].day, context.run_folder
    earlier: list[EarlierRun] = []
    left_out: list[tuple[str, str]] = []
    for name, started, _, found in finished_checks(own.parent, left_out, own):
        run = started.name or name
        if found.baseline != day.baseline:
            continue
        if why := day.same_check(found):
            left_out.append((run, why))
        else:
            earlier.append(EarlierRun(run=run, began=started.calendar, day=found))
    earlier.sort(key=lambda each: (each.began, len(each.run), each.run))
    return EarlierRunsRow(runs=tuple(earlier), left_out=tuple(sorted(left_out)))


class Limits(Protocol):
    """The procedure's settings."""

    @property
    def baseline_runs(self) -> int:
        """Runs of the baseline."""

    @property
    def false_alarm(self) -> float:
        """Per run and chart."""

    @property
    def weight(self) -> float:
        """λ of the EWMA."""


def judged(context: StepContext, limits: Limits) -> tuple[DailyVerdict, ControlChartRow | None]:
    """The verdict of this run, and the charts of all runs since the baseline."""
    earlier, own = context.recorded(EarlierRunsRow)[-1], context.recorded(DailyPointsRow)[-1].day
    point = context.recorded(PoseRow)[0].point
    began = [*(each.began for each in earlier.runs), context.calendar]
    found = charts([*(each.day for each in earlier.runs), own], limits)
    daily = DailyFigures(
        baseline=own.baseline,
        baseline_runs=min(len(began), limits.baseline_runs),
        baseline_needed=limits.baseline_runs,
        since=len(found),
        left_out=len(earlier.left_out),
        false_alarm=limits.false_alarm,
        reason="none",
    )
    if not found:
        sentence = (
            f"Baseline '{own.baseline}', run {len(began)} of {limits.baseline_runs}: nothing is judged until it is "
            "complete."
        )
        return _verdict("baseline", sentence, daily, point.accuracy, noise_only=point.noise_only), None
    last = found[-1]
    daily = replace(
        daily,
        reason=last.reason.value,
        t2=last.t2,
        t2_limit=last.t2_limit,
        ewma=last.ewma,
        ewma_limit=last.ewma_limit,
    )
    verdict = _verdict(last.action.value, last.words, daily, point.accuracy, noise_only=point.noise_only)
    return verdict, _chart(began[-len(found) :], found)


def charts(days: Sequence[DayPoints], limits: Limits) -> list[Found]:
    """The verdict of each run since the baseline; none before it is complete. days: oldest first."""
    runs = in_one_frame([day.points for day in days], [day.nests for day in days], [day.spread for day in days])
    count = limits.baseline_runs
    if len(runs) <= count:
        return []
    nominal = runs[:count].mean(axis=0)
    baseline = DailyBaseline.of(runs[:count], nominal, rigid_and_scale(nominal), RIGID_AND_SCALE)
    check = CheckLimits(limits.false_alarm, limits.weight)
    return [daily_check(baseline, runs[count : last + 1], check) for last in range(count, len(runs))]


def _chart(began: Sequence[str], found: Sequence[Found]) -> ControlChartRow:
    return ControlChartRow(
        began=tuple(began),
        t2=tuple(each.t2 for each in found),
        t2_limit=found[-1].t2_limit,
        ewma=tuple(each.ewma for each in found),
        ewma_limit=found[-1].ewma_limit,
        features=RIGID_AND_SCALE,
        deviations=tuple(tuple(each.features.tolist()) for each in found),
        verdict=tuple(each.action.value for each in found),
    )


def _verdict(verdict: str, sentence: str, daily: DailyFigures, accuracy: str, *, noise_only: bool) -> DailyVerdict:
    lines = [
        f"Baseline '{daily.baseline}': {daily.baseline_runs} of {daily.baseline_needed} runs. Without a change, "
        f"{100 * daily.false_alarm:.2g} % of runs are beyond the limit of T², and as many beyond that of the EWMA."
    ]
    if daily.t2 is not None and daily.ewma is not None:
        lines.append(
            f"T² {daily.t2:.1f} (limit {daily.t2_limit:.1f}), EWMA {daily.ewma:.2f} (limit {daily.ewma_limit:.2f})."
        )
    if noise_only:
        lines.append(f"The instrument's accuracy {accuracy} is a profile of noise only, not of its behaviour.")
    return DailyVerdict(
        verdict=verdict,
        sentence=sentence,
        lines=tuple(lines),
        daily=daily,
        accuracy=accuracy,
        noise_only=noise_only,
    )


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
