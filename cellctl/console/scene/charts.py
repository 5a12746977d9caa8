"""The two live charts of a run: residual by point, and the predicted σ."""

from __future__ import annotations

import json
from collections.abc import Callable
from itertools import chain, repeat
from pathlib import Path
from typing import Any, final

from nicegui import ui

from cellctl.console.scene.chart_options import Options, residual_options, sigma_options
from cellctl.console.scene.series import Series
from cellctl.console.scene.view import CSS

_SCRIPT = (Path(__file__).parent / "charts.js").read_text(encoding="utf-8")


@final
class ChartsView:
    """Both charts on a page. `update` sends the points that changed; a whole chart only with its first points."""

    def __init__(self, series: Series) -> None:
        ui.add_css(CSS)
        ui.add_head_html(f"<script>{_SCRIPT}</script>")
        with ui.element("div").classes("charts-view"):
            self._residuals = _Chart("Residual by point", residual_options, series)
            self._sigmas = _Chart("Predicted σ of the compensated robot", sigma_options, series)
        self.update(series)

    def update(self, series: Series) -> None:
        """Show `series`."""
        self._residuals.show(series, series.residual_note)
        self._sigmas.show(series, series.sigma_note)


def charts_view(series: Series) -> ChartsView:
    """Both charts of `series`, at this place of the page."""
    return ChartsView(series)


@final
class _Chart:
    """A chart with its heading and its note."""

    def __init__(self, title: str, options: Callable[[Series], Options], series: Series) -> None:
        self._options = options
        with ui.element("div").classes("chart"):
            ui.html(title, tag="h3", sanitize=False)
            self._chart = ui.echart(options(series)).props("role=img")
            self._chart.props["aria-label"] = f"Chart: {title}"
            self._note = ui.label().classes("note").props("role=status")

    def show(self, series: Series, note: str) -> None:
        before, after = self._chart.options, self._options(series)
        if self._note.text != note:
            self._note.set_text(note)
        self._note.classes(add="unseen" if after["graphic"] else "", remove="" if after["graphic"] else "unseen")
        if after == before:
            return
        changed = changes(before, after)
        before.clear()
        before.update(after)
        if changed is None:
            self._chart.update()
        else:
            self._chart.client.run_javascript(f"cellctlChangeChart({self._chart.id}, {json.dumps(changed)})")


def changes(before: Options, after: Options) -> list[list[tuple[int, Any]]] | None:
    """Of each series the points that are new or changed, with their places; None if more than points differs."""
    if _frame(before) != _frame(after):
        return None
    found = []
    for old, new in zip(before["series"], after["series"], strict=True):
        if len(new["data"]) < len(old["data"]):
            return None
        padded = chain(old["data"], repeat(None))
        found.append(
            [
                (place, point)
                for place, (was, point) in enumerate(zip(padded, new["data"], strict=False))
                if was != point
            ]
        )
    return found


def _frame(options: Options) -> Options:
    """All but the points."""
    return {**options, "series": [{**each, "data": None} for each in options["series"]]}
