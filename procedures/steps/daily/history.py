"""Histories of daily checks: what the runs of a folder measured, as control charts. Reads journals alone."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from hashlib import blake2b
from pathlib import Path
from typing import Any, Self, TypeAlias, final

from cellctl.files import InputError
from cellctl.journal import JournalError, RunStarted, RunState, fold, read_journal
from cellctl.metrology import RIGID_AND_SCALE, ControlChart, control_chart, deviations, in_one_frame
from cellctl.operations.campaign_services import runs_to_compare
from procedures.steps.daily.rows import DailyPointsRow, DailyVerdict, DayPoints

SECTION = DailyVerdict.SECTION[0]
"""A field that only results of this kind of campaign have."""

HISTORY = "daily"
"""The name of the history among those of all campaigns."""

_Found: TypeAlias = "tuple[DailyCheck, DayPoints]"


@final
@dataclass(frozen=True, slots=True)
class DailyCheck:
    """A finished check: its verdict, and the statistics by which it was judged; None before the baseline was complete.

    began: ISO 8601. needed: runs of the baseline that its procedure asks for.
    """

    run: str
    began: str
    verdict: str
    sentence: str
    needed: int
    t2: float | None = None
    t2_limit: float | None = None
    ewma: float | None = None
    ewma_limit: float | None = None


@final
@dataclass(frozen=True)
class DailyHistory:
    """The checks of one robot that can be compared, oldest first. baseline: its name; payload_kg; accuracy: profile.

    charts: a control chart, mm, for each way in which the points move together (`x` … `turn z`, `scale`; a turn and
    the scale as RMS motion of the points), about the mean of the baseline; none for fewer than two checks.
    """

    robot: str
    baseline: str
    payload_kg: float
    accuracy: str
    checks: tuple[DailyCheck, ...]
    charts: Mapping[str, ControlChart]

    @classmethod
    def of(cls, found: Sequence[_Found], baseline_runs: int | None = None) -> Self:
        """From checks and their points, in any order. baseline_runs: None: as many as the last check's procedure."""
        ordered = sorted(found, key=lambda pair: (pair[0].began, pair[0].run))
        checks, days = tuple(pair[0] for pair in ordered), [pair[1] for pair in ordered]
        day = days[0]
        charts = _charts(days, baseline_runs or checks[-1].needed)
        return cls(day.robot, day.baseline, day.payload_kg, day.accuracy, checks, charts)

    @property
    def provisional(self) -> bool:
        """Whether the baseline is not complete, so that the limits still change with each check."""
        return len(self.checks) < self.checks[-1].needed

    def to_json(self) -> dict[str, Any]:
        """As JSON has it; the first moving range of a chart is null."""
        names = ("robot", "baseline", "payload_kg", "accuracy", "provisional")
        charts = [{"name": name, "unit": "mm", **_json(chart)} for name, chart in self.charts.items()]
        return {
            **{name: getattr(self, name) for name in names},
            "checks": [asdict(check) for check in self.checks],
            "charts": charts,
        }


def daily_entry(state: RunState) -> tuple[str, str, dict[str, Any]] | None:
    """What the history of daily checks keeps of a finished run: its series, the title of that, check and points.

    None for a run of another kind. Raises InputError if its rows cannot be read.
    """
    started = state.started
    if started is None or SECTION not in state.section or (row := state.last(DailyPointsRow)) is None:
        return None
    day = row.day
    same = (day.baseline, day.robot, day.payload_kg, day.accuracy, day.commanded, day.nest_names)
    title = f"{day.robot}, baseline ‘{day.baseline}’, {day.payload_kg:g} kg"
    content = {"check": asdict(_check("", started, state)), "points": row.data()}
    return blake2b(repr(same).encode(), digest_size=12).hexdigest(), title, content


def compared_checks(found: Sequence[tuple[str, Mapping[str, Any]]], baseline_runs: int | None = None) -> DailyHistory:
    """The history of the checks of one series: name and content of each, at least one.

    baseline_runs: number of first checks that give the limits, at least 2; None: as the procedure of the last check
    says. Raises ValueError if their points cannot be compared.
    """
    checks = [
        (DailyCheck(**{**content["check"], "run": run}), DailyPointsRow.read(content["points"]).day)
        for run, content in found
    ]
    return DailyHistory.of(checks, baseline_runs)


def finished_checks(
    runs: Path, left_out: list[tuple[str, str]], but: Path | None = None
) -> Iterator[tuple[str, RunStarted, RunState, DayPoints]]:
    """Name, start, state and points of each finished check in the folder `runs`, except that in the folder `but`.

    Name and reason of those that cannot be read are added to `left_out`.
    """
    for name in runs_to_compare(runs, HISTORY):  # opening every journal of 75 000 runs takes a minute
        journal = runs / name / "journal.sqlite"
        if but and journal.parent.resolve() == but.resolve():
            continue
        try:
            first = next(read_journal(journal), None)
            if first is None or not isinstance(first.event, RunStarted) or SECTION not in (first.event.section or ()):
                continue
            state = fold(read_journal(journal))
            row = state.last(DailyPointsRow) if state.state == "finished" else None
        except (InputError, JournalError):
            left_out.append((journal.parent.name, "its journal is damaged"))
            continue
        if row:
            yield journal.parent.name, first.event, state, row.day


def _check(run: str, started: RunStarted, state: RunState) -> DailyCheck:
    verdict = state.data_of(DailyVerdict.KIND)[-1:]
    said: Mapping[str, Any] = verdict[0] if verdict else {}
    figures = said.get(SECTION) or {}
    statistics = {name: figures.get(name) for name in ("t2", "t2_limit", "ewma", "ewma_limit")}
    needed = figures.get("baseline_needed", 20)
    return DailyCheck(run, started.calendar, said.get("verdict", ""), said.get("sentence", ""), needed, **statistics)


def _charts(days: Sequence[DayPoints], baseline: int) -> dict[str, ControlChart]:
    if len(days) < 2:
        return {}
    points = in_one_frame([day.points for day in days], [day.nests for day in days], [day.spread for day in days])
    columns = deviations(points, baseline).T
    return {name: control_chart(values, baseline) for name, values in zip(RIGID_AND_SCALE, columns, strict=True)}


def _json(chart: ControlChart) -> dict[str, Any]:
    lower, upper = chart.limits
    return {
        "values": chart.values.tolist(),
        "ranges": [None, *chart.ranges[1:].tolist()],
        "baseline": chart.baseline,
        "centre": chart.centre,
        "lower": lower,
        "upper": upper,
        "range_limit": chart.range_limit,
        "signals": [[str(rule) for rule in rules] for rules in chart.signals],
    }
