"""Histories of daily checks as control charts, on their page of the console."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, final
from urllib.parse import quote

from nicegui import ui

from cellctl.console.appearance import (
    Cell,
    facts,
    figures,
    look_of_verdict,
    numbers,
    section,
    shown_time,
    state_word,
    words,
)
from cellctl.console.charts import ranges_chart, statistic_chart, values_chart
from cellctl.report import fixed
from procedures.steps.daily.history import DailyCheck, DailyHistory


@final
class DailyView:
    """Shows a history, with the chart of the chosen way in which the points move together."""

    def __init__(self) -> None:
        self._way = ""
        self._area = ui.element("div").style("display: contents")

    def __call__(self, found: DailyHistory) -> None:
        """Show this history from now on."""
        self._found = found
        self._show()

    def _show(self) -> None:
        self._area.clear()
        with self._area:
            history = self._found
            _head(history)
            if history.charts:
                _statistics(history)
                _individuals(history, self._way or _most(history), self._choose)
            _checks(history)

    def _choose(self, way: str) -> None:
        self._way = way
        self._show()


def _head(history: DailyHistory) -> None:
    last = history.checks[-1]
    with ui.element("div").classes("row"):
        state_word(look_of_verdict(last.verdict), last.verdict, large=True)
        ui.label(f"{last.sentence} ({shown_time(last.began)})")
    count = len(history.checks)
    baseline = f"‘{history.baseline}’, {min(count, last.needed)} of {last.needed} checks"
    facts(
        {
            "Robot": history.robot,
            "Load": f"{history.payload_kg:g} kg",
            "Instrument": f"accuracy profile {history.accuracy}",
            "Baseline": baseline + (": not complete, limits are provisional" if history.provisional else ""),
        }
    )


def _days(history: DailyHistory) -> list[str]:
    return [shown_time(check.began, "%m-%d %H:%M") for check in history.checks]


def _statistics(history: DailyHistory) -> None:
    last, days = history.checks[-1], _days(history)
    if last.t2_limit is None or last.ewma_limit is None:
        return
    note = "The verdict of a check is by these two: T² sees a sudden change, the EWMA a slow one."
    with section("T² and EWMA", note=note), ui.element("div").classes("columns"):
        for title, values, limit in (
            ("T²", [check.t2 for check in history.checks], last.t2_limit),
            ("EWMA", [check.ewma for check in history.checks], last.ewma_limit),
        ):
            statistic_chart(days, values, limit, last.needed, title)


def _most(history: DailyHistory) -> str:
    """The way with the largest deviation of the last check, in σ."""
    return max(history.charts, key=lambda name: abs(_in_sigmas(history, name)))


def _in_sigmas(history: DailyHistory, name: str) -> float:
    chart = history.charts[name]
    return float((chart.values[-1] - chart.centre) / chart.sigma) if chart.sigma > 0.0 else 0.0


def _individuals(history: DailyHistory, way: str, choose: Any) -> None:
    note = "Each way in which the points move together; turns and scale as RMS motion of the points. Limits: ± 3 σ."
    with section("Individual values", note=note):
        rows, marked = [], []
        for number, (name, chart) in enumerate(history.charts.items()):
            signals = "; ".join(chart.signals[-1]) or "–"
            values = (chart.values[-1], chart.centre, *chart.limits)
            rows.append([name, *(fixed(value) for value in values), fixed(_in_sigmas(history, name), 1), signals])
            marked += [number] if chart.signals[-1] else []
        limits = numbers("last, mm", "centre, mm", "lower limit, mm", "upper limit, mm", "last, σ")
        columns = [*words("Way"), *limits, *words("signals of the last check")]
        figures(columns, rows, label="Last check", marked=frozenset(marked))
        chosen = ui.toggle(list(history.charts), value=way, on_change=lambda event: choose(event.value))
        chosen.props('no-caps unelevated dense aria-label="Chart of"').classes("ways")
        days, chart = _days(history), history.charts[way]
        values_chart(days, chart)
        ranges_chart(days, chart).classes("low")
        _signals(history, chart.signals)


def _signals(history: DailyHistory, signals: Sequence[Sequence[Any]]) -> None:
    listed = [
        f"{shown_time(check.began)}: {', '.join(rules)}"
        for check, rules in zip(history.checks, signals, strict=True)
        if rules
    ]
    ui.label(f"Signals: {'; '.join(listed) or 'none'}").classes("note")


def _checks(history: DailyHistory) -> None:
    columns = [*words("Check", "Began", "Verdict"), *numbers("T²", "EWMA")]
    with section("Checks"):
        figures(columns, map(_row, reversed(history.checks)), label="Checks").style("max-height: 24rem")


def _row(check: DailyCheck) -> list[Cell]:
    return [
        lambda: ui.link(check.run, f"/run/{quote(check.run)}/result"),
        shown_time(check.began),
        lambda: state_word(look_of_verdict(check.verdict), check.verdict),
        fixed(check.t2, 1),
        fixed(check.ewma, 2),
    ]
