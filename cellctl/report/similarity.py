"""The page of `cellctl analyse`: correlation of distances, semivariograms overall and for each joint."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cellctl.analysis import Similarity
from cellctl.error_maps.kriging import EmpiricalSemivariogram
from cellctl.files import write_atomically
from cellctl.formats.similarity_report import p_text, result_sentences
from cellctl.kinematics import Floats
from cellctl.report._page import template
from cellctl.report.drawing import ACCENT, BEFORE, FAINT, HELD_OUT, INK, svg_of
from cellctl.report.figures import fixed
from cellctl.version import __version__

_COLOURS = {"x": ACCENT, "y": HELD_OUT, "z": BEFORE}
_DRAWN, _BINS, _LEAST_PAIRS = 1500, 20, 5


def write_similarity_page(
    path: Path, found: Similarity, report: dict[str, Any], title: str, sources: dict[str, str]
) -> None:
    """Write the page to `path`. Raises OSError."""
    write_atomically(path, similarity_page(found, report, title, sources))


def similarity_page(found: Similarity, report: dict[str, Any], title: str, sources: dict[str, str]) -> str:
    """The analysis as HTML: no script, nothing fetched, no date; the same analysis gives the same bytes.

    report: `similarity_report`; title: the robot; sources: name and text of each input.
    """
    joints = sorted({joint for each in found.by_joint.values() for joint in each})
    return template("similarity.html").render(
        title=title,
        conditions=[*sources.items(), *_conditions(report)],
        sentences=result_sentences(report),
        lines=[
            _line(part, space, each) for part, spaces in report["correlation"].items() for space, each in spaces.items()
        ],
        scatter=_scatter(found),
        overall=_overall(found),
        models=[_model_line(name, each) for name, each in found.overall.items()],
        joints=by_joint(found, joints),
        permutations=report["correlation"]["3-D"]["Dq"]["permutations"],
        version=__version__,
    )


def _conditions(report: dict[str, Any]) -> list[tuple[str, str]]:
    error = report["error"]
    return [
        ("postures", f"{report['postures']}, {report['pairs']} pairs"),
        ("error, mm", f"mean {error['mean']:.3f}, RMS {error['rms']:.3f}, max {error['max']:.3f}"),
        ("seed", str(report["seed"])),
    ]


def _line(part: str, space: str, each: dict[str, Any]) -> dict[str, str]:
    ends = f"{fixed(each['low_95'])} … {fixed(each['high_95'])}"
    wrong = p_text(each["p_if_independent"])
    return {"part": part, "space": space, "r": fixed(each["r"]), "p": p_text(each["p"]), "ends": ends, "wrong": wrong}


def _model_line(name: str, each: EmpiricalSemivariogram) -> dict[str, str]:
    model = each.model
    numbers = (model.nugget, model.sill, model.range, model.rms) if model else (None,) * 4
    return dict(zip(("name", "nugget", "sill", "range", "rms"), (name, *map(fixed, numbers)), strict=True))


def _scatter(found: Similarity) -> str:
    """De over Dq and over Dp: some of the pairs, the mean of each of 20 bins, and the middle 80 %."""
    some = np.linspace(0, len(found.de) - 1, min(len(found.de), _DRAWN)).astype(int)

    def draw(figure: Figure) -> None:
        both = figure.subplots(1, 2, sharey=True)
        for axes, distance, label in zip(both, (found.dq, found.dp), ("Dq, deg", "Dp, mm"), strict=True):
            axes.plot(distance[some], found.de[some], ".", color=FAINT, markersize=2.5)
            centre, mean, low, high = _binned(distance, found.de)
            axes.fill_between(centre, low, high, color=ACCENT, alpha=0.15, linewidth=0)
            axes.plot(centre, mean, "o-", color=ACCENT, markersize=3, linewidth=1.2)
            axes.set(xlabel=label)
        both[0].set(ylabel="De, mm", ylim=(0.0, None))

    return svg_of(draw, "scatter", 2.6, "Distance of two errors over the distance of joints, and of positions")


def _binned(distance: Floats, values: Floats) -> tuple[Floats, ...]:
    """Centre, mean, 10 % and 90 % quantile of `values` in 20 equal bins with five pairs or more."""
    edges = np.linspace(distance.min(), distance.max(), _BINS + 1)
    which = np.clip(np.searchsorted(edges, distance, side="right") - 1, 0, _BINS - 1)
    rows = []
    for number in range(_BINS):
        mine = values[which == number]
        if len(mine) >= _LEAST_PAIRS:
            rows.append([(edges[number] + edges[number + 1]) / 2, mine.mean(), *np.quantile(mine, [0.1, 0.9])])
    return tuple(np.array(rows).T)


def _overall(found: Similarity) -> str:
    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for name, each in found.overall.items():
            _curve(axes, each, _COLOURS[name], label=f"error along {name}")
        axes.axhline(1.0, color=INK, linewidth=0.5, linestyle=":")
        axes.set(xlabel="distance of the standardised joints", ylabel="semivariance", ylim=(0.0, None))
        axes.legend(loc="upper left")

    return svg_of(draw, "overall", 2.6, "Semivariogram of each component of the error over the distance of the joints")


def by_joint(found: Similarity, joints: Sequence[int]) -> str:
    """A panel for each component and joint: all pairs, and those that are near in the other joints."""

    def draw(figure: Figure) -> None:
        panels = figure.subplots(len(found.by_joint), len(joints), sharey=True, squeeze=False)
        for row, (name, each) in zip(panels, found.by_joint.items(), strict=True):
            for axes, joint in zip(row, joints, strict=True):
                _curve(axes, each[joint], _COLOURS[name])
                _curve(axes, found.by_joint_near[name][joint], INK, dashed=True)
                axes.set(xlabel="", ylim=(0.0, 2.5))
                axes.tick_params(labelsize=6)
            row[0].set(ylabel=f"along {name}")
        for axes, joint in zip(panels[0], joints, strict=True):
            axes.set_title(f"A{joint}", loc="left")

    return svg_of(draw, "by-joint", 1.2 * len(found.by_joint) + 0.4, "Semivariograms over the distance of each joint")


def _curve(axes: Axes, each: EmpiricalSemivariogram, colour: str, label: str = "", *, dashed: bool = False) -> None:
    there = each.pairs >= _LEAST_PAIRS
    axes.plot(each.centre[there], each.gamma[there], "o", color=colour, markersize=1.8 if dashed else 2.5, label=label)
    if each.model is not None and there.any():
        h = np.linspace(0.0, float(each.centre[there].max()), 60)
        axes.plot(h, each.model.at(h), "--" if dashed else "-", color=colour, linewidth=0.9)
