"""The live charts of a run: residual by point, predicted σ, error after each batch; series, options, drawing."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import chain, repeat
from pathlib import Path
from typing import Any, final

import numpy as np
from nicegui import ui

from cellctl.console.appearance import head_script, head_style
from cellctl.console.scene._content import read_points
from cellctl.console.scene.run_points import ROBOTS, Points, Role, SceneRun, Setting, installed_sources
from cellctl.console.scene.view import CSS
from cellctl.files import InputError
from cellctl.journal import RunState
from cellctl.kinematics import Floats
from cellctl.records import BatchRow, IdentificationRow

NOMINAL, IDENTIFIED = ROBOTS

Pair = tuple[float, float]

_NOMINAL, _IDENTIFIED, _SIGMA = "#d55e00", "#0072b2", "#4b545e"
_SOFT, _LINE = "#5a6169", "#e4e8ec"
_FONT = "'Helvetica Neue', Arial, 'Liberation Sans', sans-serif"
_FEW = 400
"""More points than these are drawn smaller."""

LEAST_MM = 0.001
"""Smaller values are drawn here: a logarithmic scale has no zero, and less than 1 µm means nothing."""

Options = dict[str, Any]

_ICONS = {"solid": "path://M0 4h24v2H0z", "dashed": "path://M0 4h10v2H0z M14 4h10v2H14z"}
_DASHES = tuple(_ICONS)

_EMPTY = {"min": 0.01, "max": 10}
"""The range of a chart without points."""

_RANGE = {
    ":min": "(range) => Math.min(0.01, 10 ** Math.floor(Math.log10(range.min)))",
    ":max": "(range) => Math.max(10, 10 ** Math.ceil(Math.log10(range.max)))",
}
"""The range of the colours, or more if there are such values: charts can be compared."""

_TOOLTIP = "(p) => p.data[2] ? `${p.data[2]}<br>${p.seriesName}: ${p.data[3].toFixed(3)} mm` : p.seriesName"

_SCRIPT = (Path(__file__).parent / "charts.js").read_text(encoding="utf-8")


@final
@dataclass(frozen=True, eq=False)
class Line:
    """One series of a chart. xy: place in the order of measurement, from 1, and value, mm. labels: of each point.

    robot: what the values are of: NOMINAL, IDENTIFIED, or another pair of a source; after: the second of the pair.
    held_out: no fit used these points: held-out ones, and targets.
    """

    name: str
    robot: str
    after: bool
    held_out: bool
    xy: tuple[Pair, ...]
    labels: tuple[str, ...]


@final
@dataclass(frozen=True, eq=False)
class Series:
    """What the charts show, mm. measured: points so far.

    residuals: by robot and by use of the points. sigmas: predicted 1 σ of targets, in the order of measurement, and
    errors: the residual found at the same targets. levels: name and value of each σ over the joints of the fit.
    residual_note, sigma_note: what is not known yet or is preliminary; empty if nothing. batches: of a campaign that
    ends at a goal.
    """

    measured: int = 0
    residuals: tuple[Line, ...] = ()
    sigmas: tuple[Line, ...] = ()
    errors: tuple[Line, ...] = ()
    levels: tuple[tuple[str, float], ...] = ()
    residual_note: str = ""
    sigma_note: str = ""
    batches: tuple[BatchRow, ...] = ()

    @property
    def batch_note(self) -> str:
        """What is known after the last batch; empty without."""
        return self.batches[-1].sentence if self.batches else ""


def series_of(state: RunState, points: Sequence[Points] | None = None) -> Series:
    """The series of a run so far; points: those of its `SceneContent`, if that is at hand.

    What cannot be read is left out; `scene_of` states why.
    """
    if points is None:
        points = read_points(SceneRun(state, Setting.of(state.started)), installed_sources()[0], [])
    groups = [group for group in points if group.role is not Role.CHECK]
    order = _order(groups)
    levels = _levels(state)
    targets = [group for group in groups if np.isfinite(group.sigma).any()]
    residuals = tuple(_residual_lines(groups, order))
    sigmas = [_joined(targets, [each.sigma for each in targets], order, "predicted σ", IDENTIFIED, True)]
    errors = [_joined(targets, [each.after for each in targets], order, "found error", IDENTIFIED, True)]
    return Series(
        measured=len(order),
        residuals=residuals,
        sigmas=tuple(line for line in sigmas if line.xy),
        errors=tuple(line for line in errors if line.xy),
        levels=levels,
        residual_note=_residual_note(residuals, identified=bool(levels)),
        sigma_note=_sigma_note(levels, targets),
        batches=_batches(state),
    )


def _order(groups: Sequence[Points]) -> dict[float, int]:
    """Event → place in the order of measurement, from 1."""
    events = np.concatenate([group.seq for group in groups]) if groups else np.zeros(0)
    return {seq: place for place, seq in enumerate(np.unique(events[events > 0]).tolist(), 1)}


def _residual_lines(groups: Sequence[Points], order: dict[float, int]) -> list[Line]:
    uses = ((Role.FIT, "points of the fit"), (Role.HELD_OUT, "held-out points"), (Role.TARGET, "targets"))
    lines = []
    for pair in dict.fromkeys(group.compared for group in groups):
        for after, robot in enumerate(pair):
            for role, use in uses:
                mine = [each for each in groups if each.role is role and each.compared == pair]
                columns = [each.after if after else each.before for each in mine]
                lines.append(_joined(mine, columns, order, f"{robot}, {use}", robot, bool(after)))
    return [line for line in lines if line.xy]


def _joined(
    groups: Sequence[Points], columns: Sequence[Floats], order: dict[float, int], name: str, robot: str, after: bool
) -> Line:
    """One line of the points of all `groups` whose values, one column for each group, are known."""
    found = sorted(
        ((float(order[float(group.seq[k])]), float(values[k])), f"{group.name} {group.label[k]}")
        for group, values in zip(groups, columns, strict=True)
        for k in np.flatnonzero(np.isfinite(values) & (group.seq > 0)).tolist()
    )
    held_out = any(group.role is not Role.FIT for group in groups)
    return Line(name, robot, after, held_out, tuple(pair for pair, _ in found), tuple(label for _, label in found))


def _levels(state: RunState) -> tuple[tuple[str, float], ...]:
    try:
        row = state.last(IdentificationRow)
    except InputError:
        return ()
    if row is None:
        return ()
    known = (
        ("RMS over the joints of the fit", row.sigma_rms_mm),
        ("greatest over the joints of the fit", row.sigma_max_mm),
    )
    return tuple((name, float(values["among"])) for name, values in known if "among" in values)


def _batches(state: RunState) -> tuple[BatchRow, ...]:
    try:
        return tuple(state.recorded(BatchRow))
    except InputError:
        return ()


def _residual_note(residuals: Sequence[Line], *, identified: bool) -> str:
    if not residuals:
        return "No residual is known yet: it needs some measured points."
    if not identified and not any(line.after for line in residuals):
        return (
            "Preliminary: the nominal robot against centres or an instrument fitted to the points so far. "
            "An identification replaces them."
        )
    return ""


def _sigma_note(levels: Sequence[object], targets: Sequence[Points]) -> str:
    if not levels:
        return "σ is not known yet: the identification predicts it."
    return "" if targets else "σ of each target is not in the journal yet; the lines are σ over the joints of the fit."


def residual_options(series: Series) -> Options:
    """Residual by point: colour and shape by robot and use."""
    shown = [_scatter(line, *_look(line), size=_size(series)) for line in series.residuals]
    return _options(shown, "measured point, in order", "residual, mm", series.residual_note if not shown else "")


def sigma_options(series: Series) -> Options:
    """Predicted σ of each target with the error found there, and σ over the joints of the fit."""
    size = _size(series)
    shown = [
        *(_scatter(line, _SIGMA, "emptyCircle", size) for line in series.sigmas),
        *(_scatter(line, _IDENTIFIED, "triangle", size) for line in series.errors),
        *(
            _level(name, value, dash, series.measured)
            for (name, value), dash in zip(series.levels, _DASHES, strict=False)
        ),
    ]
    return _options(shown, "measured point, in order", "1 σ, mm", series.sigma_note if not shown else "")


def batch_options(series: Series) -> Options:
    """Quantiles of the predicted volumetric error over the rows of the fit, and the goal."""
    names = (("95 %", "high_mm", "solid"), ("median", "median_mm", "dashed"), ("5 %", "low_mm", "dashed"))
    rows = series.batches
    shown = [
        _curve(name, [(row.rows, getattr(row, field)) for row in rows], _IDENTIFIED, dash)
        for name, field, dash in names
    ]
    if rows:
        goal = rows[-1].goal_mm
        ends = [(0, goal), (max(rows[-1].rows, 2), goal)]
        shown.append(_curve(f"goal: {goal:g} mm", ends, _NOMINAL, "solid", symbol="none"))
    return _options(shown, f"{rows[-1].noun if rows else 'rows'} of the fit", "volumetric error, mm", "")


def _curve(name: str, points: Sequence[Pair], colour: str, dash: str, symbol: str = "circle") -> Options:
    return {
        "type": "line",
        "name": name,
        "data": [[int(x), round(max(y, LEAST_MM), 4)] for x, y in points],
        "symbol": symbol,
        "lineStyle": {"color": colour, "width": 1.5, "type": dash},
        "itemStyle": {"color": colour},
        "animation": False,
    }


def _look(line: Line) -> tuple[str, str]:
    """Colour, and symbol: hollow for points of the fit, filled where no fit used them."""
    colour = _IDENTIFIED if line.after else _NOMINAL
    filled = "triangle" if line.name.endswith("targets") else "diamond"
    return colour, filled if line.held_out else "emptyCircle"


def _size(series: Series) -> float:
    return 7.0 if series.measured <= _FEW else 4.0


def _scatter(line: Line, colour: str, symbol: str, size: float) -> Options:
    filled = not symbol.startswith("empty")
    return {
        "type": "scatter",
        "name": line.name,
        "data": data_of(line),
        "symbol": symbol,
        "symbolSize": size * (1.25 if filled else 1.0),
        "itemStyle": {"color": colour, "opacity": 0.9},
        "emphasis": {"scale": 1.4},
        "animation": False,
    }


def data_of(line: Line) -> list[list[object]]:
    """A line's points for ECharts: place, value for the logarithmic scale, label, value."""
    pairs = zip(line.xy, line.labels, strict=True)
    return [[int(place), round(max(value, LEAST_MM), 4), label, round(value, 4)] for (place, value), label in pairs]


def _level(name: str, value: float, dash: str, measured: int) -> Options:
    """A level over all points; its name has the value."""
    return {
        "type": "line",
        "name": f"σ, {name}: {value:.3f} mm",
        "data": [[1, value], [max(measured, 2), value]],
        "symbol": "none",
        "lineStyle": {"color": _SIGMA, "width": 1.5, "type": dash},
        "itemStyle": {"color": _SIGMA},
        "animation": False,
    }


def _options(shown: list[Options], x: str, y: str, empty: str) -> Options:
    return {
        "textStyle": {"fontFamily": _FONT},
        "animation": False,
        "grid": {"left": 58, "right": 14, "top": 12, "bottom": 46 + 22 * ((len(shown) + 1) // 2)},
        "legend": {
            "bottom": 0,
            "left": 0,
            "itemGap": 14,
            "itemWidth": 12,
            "itemHeight": 10,
            "textStyle": {"color": "#1f2328"},
            "data": [_entry(each) for each in shown],
        },
        "tooltip": {"trigger": "item", ":formatter": _TOOLTIP},
        "xAxis": {
            "type": "value",
            "name": x,
            "nameLocation": "middle",
            "nameGap": 26,
            "min": 0,
            "minInterval": 1,
            **_axis(),
            "splitLine": {"show": False},
        },
        "yAxis": {
            "type": "log",
            "name": y,
            "nameLocation": "middle",
            "nameGap": 42,
            **_axis(),
            **(_RANGE if shown else _EMPTY),
        },
        "graphic": [_words(empty)] if empty else [],
        "series": shown,
        "aria": {"enabled": True},
    }


def _entry(series: Options) -> Options:
    """A series in the legend; a line as a line."""
    if series["type"] != "line":
        return {"name": series["name"]}
    return {"name": series["name"], "icon": _ICONS[series["lineStyle"]["type"]]}


def _axis() -> Options:
    return {
        "nameTextStyle": {"color": _SOFT},
        "axisLabel": {"color": _SOFT, "hideOverlap": True},
        "axisLine": {"show": True, "lineStyle": {"color": "#b8c0c8"}},
        "splitLine": {"lineStyle": {"color": _LINE}},
    }


def _words(text: str) -> Options:
    style = {
        "text": text,
        "fill": _SOFT,
        "font": f"14px {_FONT}",
        "width": 320,
        "overflow": "break",
        "lineHeight": 20,
        "textAlign": "center",
    }
    return {"type": "text", "left": "center", "top": "35%", "style": style}


@final
class ChartsView:
    """The charts on a page. `update` sends the points that changed; a whole chart only with its first points."""

    def __init__(self, series: Series) -> None:
        head_style(CSS)
        head_script(_SCRIPT)
        self._batches: _Chart | None = None
        with ui.element("div").classes("charts-view") as self._place:
            self._residuals = _Chart("Residual by point", residual_options, series)
            self._sigmas = _Chart("Predicted σ of the compensated robot", sigma_options, series)
        self.update(series)

    def update(self, series: Series) -> None:
        """Show `series`."""
        self._residuals.show(series, series.residual_note)
        self._sigmas.show(series, series.sigma_note)
        if series.batches and self._batches is None:
            with self._place:
                self._batches = _Chart("Predicted volumetric error", batch_options, series)
        if self._batches is not None:
            self._batches.show(series, series.batch_note)


def charts_view(series: Series) -> ChartsView:
    """The charts of `series`, at this place of the page."""
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
