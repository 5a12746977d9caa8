"""The page of a study: its figures over its factors, as table and as curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from cellctl.kinematics import Floats
from cellctl.report._page import template
from cellctl.report.drawing import ACCENT, HELD_OUT, INK, svg_of
from cellctl.report.figures import fixed
from cellctl.version import __version__

_COLOURS = (ACCENT, HELD_OUT, "#2e7d32", "#7b1fa2", "#c62828", "#00838f", "#6d4c41", INK)
_QUARTILES = (0.25, 0.5, 0.75)
_MOST_LINES = 400
"""Points in the table at most: a page is read, the rows are in the Parquet file."""

Row = Mapping[str, Any]


def study_page(
    name: str, kind: str, rows: Sequence[Row], varied: Sequence[str], plotted: Sequence[str], units: int, seed: str
) -> str:
    """The page as HTML: no script, nothing fetched, no date. rows: of units that are done, of `units`; varied: the
    settings with several values; plotted: the figures that are shown.
    """
    shown = [each for each in plotted if any(_is_number(row.get(each)) for row in rows)]
    points = _by(rows, varied)
    settings = [each for each in rows[0] if each not in varied and each != seed][: _first_result(rows[0], seed)]
    return template("study.html").render(
        title=name,
        conditions=[
            ("kind", f"{kind}s"),
            ("rows", f"{len(rows)} of {units}"),
            *((each, str(rows[0][each])) for each in settings if rows[0][each] != ""),
        ],
        varied=varied,
        plotted=shown,
        points=[
            {"values": key, "count": len(mine), "figures": [_texts(mine, each) for each in shown]}
            for key, mine in list(points.items())[:_MOST_LINES]
        ],
        left_out=max(len(points) - _MOST_LINES, 0),
        pictures=[_picture(rows, varied, each) for each in shown],
        version=__version__,
    )


def _first_result(row: Row, seed: str) -> int:
    return list(row).index(seed)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))


def _by(rows: Sequence[Row], names: Sequence[str]) -> dict[tuple[Any, ...], list[Row]]:
    found: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        found.setdefault(tuple(row[name] for name in names), []).append(row)
    return found


def _values(rows: Sequence[Row], figure: str) -> Floats:
    return np.array([row[figure] for row in rows if _is_number(row.get(figure))], float)


def _texts(rows: Sequence[Row], figure: str) -> list[str]:
    """Median, lower and upper quartile as text."""
    values = _values(rows, figure)
    lower, median, upper = np.quantile(values, _QUARTILES) if values.size else [np.nan] * 3
    return [fixed(float(median)), f"{fixed(float(lower))} … {fixed(float(upper))}"] if values.size else ["–", "–"]


def _picture(rows: Sequence[Row], varied: Sequence[str], figure_name: str) -> str:
    """Medians of a figure over the first varied setting, a line for each value of the second; quartiles as a band."""
    along, lines = (varied[0] if varied else ""), _by(rows, varied[1:2])

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        places = list(dict.fromkeys(row[along] for row in rows)) if along else [""]
        numbers = all(_is_number(place) for place in places)
        at = {place: float(place) if numbers else float(number) for number, place in enumerate(places)}
        for number, (key, mine) in enumerate(lines.items()):
            own = {
                place: _values([row for row in mine if not along or row[along] == place], figure_name) for place in at
            }
            there = sorted(
                (at[place], *np.quantile(values, _QUARTILES)) for place, values in own.items() if values.size
            )
            x, lower, median, upper = np.array(there, float).reshape(-1, 4).T
            colour = _COLOURS[number % len(_COLOURS)]
            axes.fill_between(x, lower, upper, color=colour, alpha=0.15, linewidth=0)
            axes.plot(x, median, "o-", color=colour, markersize=4, linewidth=1.2, label=", ".join(map(str, key)))
        if not numbers:
            axes.set_xticks(list(at.values()), [str(place) for place in at])
        axes.set(xlabel=along, ylabel=figure_name, ylim=(0.0, None))
        if varied[1:2]:
            axes.legend(title=varied[1], loc="center left", bbox_to_anchor=(1.0, 0.5))

    return svg_of(draw, f"study-{figure_name}", 2.8, f"{figure_name} over {along or 'all rows'}: median and quartiles")
