"""The options of the two charts, as ECharts reads them. Values in mm, on a logarithmic scale."""

from __future__ import annotations

from typing import Any

from cellctl.console.scene.series import Line, Series

_NOMINAL, _IDENTIFIED, _SIGMA = "#d55e00", "#0072b2", "#4b545e"
_SOFT, _LINE = "#5a6169", "#e4e8ec"
_FONT = "'Helvetica Neue', Arial, 'Liberation Sans', sans-serif"
_FEW = 400
"""More points than these are drawn smaller."""

LEAST_MM = 0.001
"""Smaller values are drawn here: a logarithmic scale has no zero, and less than 1 µm means nothing."""

Options = dict[str, Any]


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


_ICONS = {"solid": "path://M0 4h24v2H0z", "dashed": "path://M0 4h10v2H0z M14 4h10v2H14z"}
_DASHES = tuple(_ICONS)


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


_EMPTY = {"min": 0.01, "max": 10}
"""The range of a chart without points."""

_RANGE = {
    ":min": "(range) => Math.min(0.01, 10 ** Math.floor(Math.log10(range.min)))",
    ":max": "(range) => Math.max(10, 10 ** Math.ceil(Math.log10(range.max)))",
}
"""The range of the colours, or more if there are such values: charts can be compared."""

_TOOLTIP = "(p) => p.data[2] ? `${p.data[2]}<br>${p.seriesName}: ${p.data[3].toFixed(3)} mm` : p.seriesName"


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
