"""The verdict of a daily check: what this run measured and earlier ones did, carried into one frame by the nests."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Protocol

import numpy as np

from cellctl.devices import DeviceFault
from cellctl.files import InputError
from cellctl.journal import JournalError, RunStarted, RunState, fold, read_journal
from cellctl.metrology.daily_check import (
    RIGID_AND_SCALE,
    CheckLimits,
    DailyBaseline,
    daily_check,
    in_one_frame,
    rigid_and_scale,
)
from cellctl.metrology.daily_check import DailyVerdict as Found
from cellctl.procedure import StepContext
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


_SECTION = DailyVerdict.SECTION[0]
"""A field that only results of this kind of campaign have."""


def read_earlier_runs(context: StepContext) -> EarlierRunsRow:
    """The finished runs with the same baseline in the folder of this run, oldest first. Changes nothing there."""
    day = context.recorded(DailyPointsRow)[-1].day
    earlier, left_out = [], []
    for found in _finished_checks(context.run_folder):
        if isinstance(found, tuple):
            left_out.append(found)
        elif found.day.baseline == day.baseline:
            why = day.same_check(found.day)
            if why:
                left_out.append((found.run, why))
            else:
                earlier.append(found)
    earlier.sort(key=lambda each: (each.began, len(each.run), each.run))
    return EarlierRunsRow(runs=tuple(earlier), left_out=tuple(sorted(left_out)))


def _finished_checks(own: Path) -> Iterator[EarlierRun | tuple[str, str]]:
    """Each finished check beside the folder `own`; of one that cannot be read its name, and why."""
    for journal in sorted(own.parent.glob("*/journal.sqlite")):
        if journal.parent.resolve() == own.resolve():
            continue
        try:
            found = _check_in(journal)
        except (InputError, JournalError):
            found = (journal.parent.name, "its journal is damaged")
        if found:
            yield found


def _check_in(journal: Path) -> EarlierRun | tuple[str, str] | None:
    """The check that the journal holds; None if it is another campaign's, or one that did not finish."""
    first = next(read_journal(journal), None)
    if first is None or not isinstance(first.event, RunStarted) or _SECTION not in (first.event.section or ()):
        return None
    state: RunState = fold(read_journal(journal))
    row = state.last(DailyPointsRow)
    if state.state != "finished" or row is None:
        return None
    return EarlierRun(run=first.event.name or journal.parent.name, began=first.event.calendar, day=row.day)


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
