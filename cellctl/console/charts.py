"""Charts of runs: drifts and control charts. Colours of the Okabe-Ito palette; a signal has a shape of its own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from nicegui import ui

from cellctl.console.appearance import COLOURS
from cellctl.metrology import ControlChart
from cellctl.operations.comparing_runs import DatedRun, ParameterSeries
from cellctl.operations.fleet import ParameterChart

_BLUE, _RED, _GREY = COLOURS["working"], COLOURS["bad"], COLOURS["off"]
_GRID = {"left": 58, "right": 14, "top": 10, "bottom": 24}
_TIME = {"type": "time", "splitNumber": 3, "axisLabel": {"hideOverlap": True}, "axisLine": {"onZero": False}}
_ERROR_BAR = """(params, api) => {
  const low = api.coord([api.value(0), api.value(1)]), high = api.coord([api.value(0), api.value(2)]);
  const line = (x1, y1, x2, y2) => ({type: "line", shape: {x1, y1, x2, y2}, style: {stroke: "COLOUR", lineWidth: 1.2}});
  return {type: "group", children: [line(low[0], low[1], high[0], high[1]),
    line(low[0] - 4, low[1], low[0] + 4, low[1]), line(high[0] - 4, high[1], high[0] + 4, high[1])]};
}""".replace("COLOUR", _BLUE)


def drift_chart(runs: Sequence[DatedRun], series: ParameterSeries) -> ui.echart:
    """A parameter over the begin of its runs, with ± 2 σ."""
    points, bars = [], []
    for run, value, sigma in zip(runs, series.values, series.sigmas, strict=True):
        if value is not None and sigma is not None:
            points.append({"value": [run.began, _short(value)], "name": run.run})
            bars.append([run.began, _short(value - 2 * sigma), _short(value + 2 * sigma)])
    return _chart(
        {
            "grid": _GRID,
            "xAxis": _TIME,
            "yAxis": _axis(),
            "tooltip": {"trigger": "item", "formatter": "{b}<br>{c}"},
            "series": [
                {
                    "type": "custom",
                    ":renderItem": _ERROR_BAR,
                    "data": bars,
                    "encode": {"x": 0, "y": [1, 2]},
                    "silent": True,
                },
                {"type": "line", "data": points, "symbolSize": 7, "symbol": "circle", **_coloured(_BLUE)},
            ],
        },
        f"{series.label} in {series.unit}, with 2 σ",
    )


def change_chart(began: Sequence[str], chart: ParameterChart) -> ui.echart:
    """The moving average of a parameter less its reference, with its limits, over the single runs with ± 2 σ."""
    runs = list(zip(began, chart.values, chart.sigmas, chart.means, chart.limits, strict=True))
    bars = [
        [when, _short(value - 2 * sigma), _short(value + 2 * sigma)]
        for when, value, sigma, _, _ in runs
        if value is not None and sigma is not None
    ]
    means = []
    for when, _, _, mean, limit in runs:
        if mean is not None and limit is not None:
            beyond = abs(mean) > limit
            look = {"symbol": "diamond" if beyond else "circle", "symbolSize": 11 if beyond else 5}
            means.append({"value": [when, _short(mean)], **look, "itemStyle": {"color": _RED if beyond else _BLUE}})
    limits = [
        {
            "type": "line",
            "name": name,
            "data": [[when, _short(sign * limit)] for when, _, _, _, limit in runs if limit is not None],
            "symbol": "none",
            "lineStyle": {"type": "dashed", "color": _GREY, "width": 1},
            "silent": True,
        }
        for name, sign in (("upper limit", 1.0), ("lower limit", -1.0))
    ]
    return _chart(
        {
            "grid": _GRID,
            "xAxis": _TIME,
            "yAxis": _axis(),
            "tooltip": {"trigger": "axis"},
            "series": [
                {
                    "type": "custom",
                    "name": "runs",
                    ":renderItem": _ERROR_BAR.replace(_BLUE, _GREY),
                    "data": bars,
                    "encode": {"x": 0, "y": [1, 2]},
                    "silent": True,
                },
                {"type": "line", "name": "moving average", "data": means, "lineStyle": {"color": _BLUE, "width": 1}},
                *limits,
            ],
        },
        f"{chart.label} in {chart.unit}: moving average less reference, with limits",
    )


def values_chart(names: Sequence[str], chart: ControlChart) -> ui.echart:
    """Individual values with centre line, limits and signals."""
    lower, upper = chart.limits
    lines = [("upper limit", upper), ("centre", chart.centre), ("lower limit", lower)]
    signals = [bool(rules) for rules in chart.signals]
    return _control(names, chart.values.tolist(), signals, lines, chart.baseline, "individual value, mm")


def ranges_chart(names: Sequence[str], chart: ControlChart) -> ui.echart:
    """Moving ranges with their limit."""
    values = [None, *chart.ranges[1:].tolist()]
    signals = [value is not None and value > chart.range_limit for value in values]
    lines = [("upper limit", chart.range_limit), ("mean", chart.mean_range)]
    return _control(names, values, signals, lines, chart.baseline, "moving range, mm")


def statistic_chart(
    names: Sequence[str], values: Sequence[float | None], limit: float | None, baseline: int, title: str
) -> ui.echart:
    """A statistic of each check with its limit; none before the baseline was complete."""
    signals = [value is not None and limit is not None and value > limit for value in values]
    return _control(names, values, signals, [("limit", limit)] if limit else [], baseline, title)


def _control(
    names: Sequence[str],
    values: Sequence[float | None],
    signals: Sequence[bool],
    lines: Sequence[tuple[str, float]],
    baseline: int,
    title: str,
) -> ui.echart:
    data = [
        {
            "value": None if value is None else _short(value),
            "symbol": "diamond" if signal else "circle",
            "symbolSize": 12 if signal else 6,
            "itemStyle": {"color": _RED if signal else _BLUE},
        }
        for value, signal in zip(values, signals, strict=True)
    ]
    marks = [
        {
            "yAxis": _short(value),
            "name": name,
            "lineStyle": {"type": "solid" if name in ("centre", "mean") else "dashed", "color": _GREY},
            "label": {"formatter": name, "position": "insideEndTop", "color": _GREY},
        }
        for name, value in lines
    ]
    shade: dict[str, Any] = {
        "silent": True,
        "itemStyle": {"color": "#f1f4f7"},
        "label": {"show": True, "position": "insideTopLeft", "color": _GREY},
        "data": [[{"name": "baseline", "xAxis": 0}, {"xAxis": min(baseline, len(names)) - 1}]],
    }
    return _chart(
        {
            "grid": _GRID,
            "xAxis": {
                "type": "category",
                "data": list(names),
                "axisLabel": {"hideOverlap": True},
                "axisLine": {"onZero": False},
            },
            "yAxis": {**_axis(), **_range(values, lines), "name": title, "nameLocation": "middle", "nameGap": 44},
            "tooltip": {"trigger": "axis"},
            "series": [
                {
                    "type": "line",
                    "name": title,
                    "data": data,
                    "lineStyle": {"color": _BLUE, "width": 1},
                    "markLine": {"symbol": "none", "silent": True, "data": marks},
                    "markArea": shade,
                }
            ],
        },
        title,
    )


def _chart(options: dict[str, Any], label: str) -> ui.echart:
    found = ui.echart({"animation": False, "textStyle": {"fontFamily": "inherit"}, **options})
    found.classes("chart").props("role=img")
    found.props["aria-label"] = label
    return found


def _axis() -> dict[str, Any]:
    label = {"showMinLabel": False, "showMaxLabel": False}
    return {"type": "value", "scale": True, "splitLine": {"lineStyle": {"color": "#e8ebee"}}, "axisLabel": label}


def _range(values: Sequence[float | None], lines: Sequence[tuple[str, float]]) -> dict[str, float]:
    """Least and greatest value of an axis that shows all values and lines."""
    shown = [value for value in (*values, *(line for _, line in lines)) if value is not None]
    low, high = min(shown, default=0.0), max(shown, default=1.0)
    room = 0.08 * (high - low)
    return {"min": _short(low - room) if low < 0.0 else 0.0, "max": _short(high + room)}


def _coloured(colour: str) -> dict[str, Any]:
    return {"itemStyle": {"color": colour}, "lineStyle": {"color": colour, "width": 1}}


def _short(value: float) -> float:
    return float(f"{value:.6g}")
