"""The page of `cellctl fit --compare`: models on the same held-out rows, as table and as curves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from cellctl.calibration.verdict.comparison import ComparedFits, ComparedModel
from cellctl.kinematics import Floats
from cellctl.report._page import template
from cellctl.report.drawing import ACCENT, BEFORE, FAINT, HELD_OUT, INK, millimetres, svg_of
from cellctl.report.figures import fixed, percent
from cellctl.version import __version__

_COLOURS = (ACCENT, HELD_OUT, "#2e7d32", "#7b1fa2", "#c62828", "#00838f", "#6d4c41", BEFORE, "#ad1457")
_LEVELS = np.linspace(0.02, 0.98, 49)


def compared_page(found: ComparedFits, title: str, sources: dict[str, str]) -> str:
    """The comparison as HTML: no script, nothing fetched, no date. sources: name and text of each input."""
    folds = len(found.split.judged)
    return template("compared_fits.html").render(
        title=title,
        conditions=[
            *sources.items(),
            ("held out", f"{found.results[0].n_test} {found.noun}" + (f" in {folds} folds" if folds > 1 else "")),
        ],
        sentence=found.sentence,
        nominal=_texts(found.nominal),
        rows=[
            {**model_cells(each), "seconds": f"{took:.1f}"}
            for each, took in zip(found.models, found.seconds, strict=True)
        ],
        folds=folds,
        errors=error_curves(
            found.results[0].nominal_errors,
            [(each.choice, result.test_errors) for each, result in zip(found.models, found.results, strict=True)],
        ),
        by_fold=_by_fold(found) if folds > 1 else "",
        coverage=_coverage(found),
        version=__version__,
    )


def _texts(figures: Any) -> tuple[str, str, str]:
    return fixed(figures.mean), fixed(figures.rms), fixed(figures.max)


def model_cells(each: ComparedModel) -> dict[str, Any]:
    """The cells of a model's line in a table."""
    less = each.less
    return {
        "choice": each.choice,
        "terms": each.model if each.model != each.choice else "",
        "parameters": each.n_parameters,
        "figures": _texts(each.test),
        "inside": "none" if each.coverage_95 is None else percent(each.coverage_95),
        "ratio": "" if each.stated_over_found is None else f"{each.stated_over_found:.2f}",
        "less": "" if less is None else fixed(less.mean),
        "ends": "" if less is None else f"{fixed(less.low)} … {fixed(less.high)}",
        "decided": less is not None and less.decided,
    }


def error_curves(nominal: Floats, errors: Sequence[tuple[str, Floats]]) -> str:
    """Share of the held-out rows whose error (N,), mm, is at most so large: nominal's, and each model's by its name."""

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        colours = (FAINT, *(_COLOURS[place % len(_COLOURS)] for place in range(len(errors))))
        for (name, values), colour in zip([("nominal", nominal), *errors], colours, strict=True):
            share = (np.arange(len(values)) + 1.0) / len(values)
            axes.plot(np.sort(values), 100.0 * share, color=colour, linewidth=1.3, label=name)
        axes.set_xscale("log")
        millimetres(axes, "x")
        axes.set(xlabel="error, mm", ylabel="share of the held-out rows, %", ylim=(0, 100))
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))

    return svg_of(draw, "model-errors", 2.8, "Share of held-out rows over their error, for each model")


def _by_fold(found: ComparedFits) -> str:
    """Mean error of each fold."""

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for place, each in enumerate(found.models):
            means = found.fold_means(place)
            axes.plot(means, np.full(len(means), place), "o", color=_COLOURS[place % len(_COLOURS)], markersize=4)
            axes.plot([each.test.mean] * 2, [place - 0.3, place + 0.3], color=INK, linewidth=1.0)
        axes.set_yticks(range(len(found.models)), [each.choice for each in found.models])
        axes.invert_yaxis()
        axes.set(xlabel="mean error of a fold, mm")

    return svg_of(draw, "folds", 0.6 + 0.25 * len(found.models), "Mean error of each fold, for each model")


def _coverage(found: ComparedFits) -> str:
    """Share of the held-out rows in regions of each stated probability; empty where no model states σ."""
    stated = [
        (place, each.choice, result.test_p_values)
        for place, (each, result) in enumerate(zip(found.models, found.results, strict=True))
        if each.coverage_95 is not None
    ]

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        axes.plot([0, 100], [0, 100], color=FAINT, linewidth=1.0)
        for place, name, p_values in stated:
            inside = [100.0 * float(np.mean(p_values >= 1.0 - level)) for level in _LEVELS]
            axes.plot(100.0 * _LEVELS, inside, color=_COLOURS[place % len(_COLOURS)], linewidth=1.3, label=name)
        axes.set(xlabel="stated probability, %", ylabel="held-out rows inside, %", xlim=(0, 100), ylim=(0, 100))
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))

    return svg_of(draw, "coverage", 2.6, "Rows inside their regions over the stated probability") if stated else ""
