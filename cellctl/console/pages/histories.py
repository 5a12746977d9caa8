"""The page of each history that a package of campaigns brings, `/daily` among them."""

from __future__ import annotations

from typing import Any, final

from nicegui import ui

from cellctl.console.commands import indexed
from cellctl.console.frame import follow, frame
from cellctl.console.shared import console
from cellctl.installed import Compared, History, histories
from cellctl.operations.run_indexing import compared_series, left_out_of, series_of
from cellctl.run_index import RunIndex, Series

_MOST = 20
"""Number of runs that are named as left out."""


def _add(history: History) -> None:
    @ui.page(f"/{history.name}")
    def page(baseline_runs: int = 0) -> None:
        with frame(history.title, f"/{history.name}"):
            follow(_HistoryPage(history, baseline_runs if baseline_runs >= 2 else None).follow)


@final
class _HistoryPage:
    """The chosen series of a history."""

    def __init__(self, history: History, first_runs: int | None) -> None:
        self._history, self._first_runs = history, first_runs
        self._seen, self._chosen = -1, ""
        self._choice = ui.select({}, label="Series", with_input=True, on_change=self._choose).props("outlined dense")
        self._choice.style("min-width: 24rem; max-width: 36rem").set_visibility(False)
        self._none = ui.label("No run of this kind has finished in this folder of runs.")
        self._show = history.view()
        self._left_out = ui.label().classes("note pre-line")

    async def follow(self) -> None:
        """Read again if a run has begun, ended or gone."""
        now = console().live.states_version
        if now != self._seen:
            self._seen = now
            await self._read()

    async def _choose(self, event: Any) -> None:
        if event.value and event.value != self._chosen:
            self._chosen = event.value
            await self._read()

    async def _read(self) -> None:
        def asked(index: RunIndex) -> tuple[list[Series], Compared | None, list[tuple[str, str]]]:
            series, left_out = series_of(index, self._history), left_out_of(index, self._history)
            names = [each.series for each in series]
            self._chosen = self._chosen if self._chosen in names else (names[0] if names else "")
            try:
                found = compared_series(index, self._history, self._chosen, self._first_runs) if names else None
            except ValueError as error:
                found, left_out = None, [*left_out, (series[0].title, f"its runs cannot be compared: {error}")]
            return series, found, left_out

        series, found, left_out = await indexed(asked)
        options = {each.series: f"{each.title}, {each.count} run{'s' * (each.count != 1)}" for each in series}
        if options != self._choice.options:
            self._choice.set_options(options, value=self._chosen or None)
        self._choice.set_visibility(len(series) > 1)
        self._none.set_visibility(not series)
        if found:
            self._show(found)
        listed = [f"Left out: {name}: {why}" for name, why in left_out[:_MOST]]
        more = [f"and {len(left_out) - _MOST} more"] if len(left_out) > _MOST else []
        self._left_out.set_text("\n".join([*listed, *more]))


for _history in histories():
    _add(_history)
