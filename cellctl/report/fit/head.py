"""The head of a fit's page: verdict, figures, set-up, and the models that were tried."""

from __future__ import annotations

from typing import Any

from cellctl.calibration import Measured
from cellctl.calibration.estimation.evidence import estimated
from cellctl.report.figures import fit_lines
from cellctl.report.fit.story import FitStory
from cellctl.report.numbers import with_sigma

Section = dict[str, Any]


def head(story: FitStory) -> Section:
    """Sentence and figures."""
    result = story.result
    return {
        "robot": story.robot.name,
        "model": result.model,
        "verdict": result.verdict,
        "sentence": str(story.said.get("sentence") or ""),
        "lines": fit_lines({**result.summary(), "measure": story.said.get("measure", "")}),
        "converged": story.found.converged,
        "ended": story.found.ended,
        "judged": _judged(story),
        "before": "prior model" if story.task.prior is not None else "nominal robot",
        "widened": bool(_scaled(story)),
        "setup": setup(story),
        "ladder": ladder(story),
    }


def _judged(story: FitStory) -> str:
    """How the held-out rows were chosen."""
    if not story.result.n_test:
        return "No row was held out."
    if len(story.held_out):
        return "No held-out row was used for the model."
    parts = len(story.split.judged)
    return (
        f"The model is made from all rows. Each of {parts} parts of them was judged by a model made from the others: "
        "the held-out figures are of those models, the residuals below of the final one."
    )


def setup(story: FitStory) -> list[tuple[str, str]]:
    """Robot, rows by kind, sessions, free parameters: name and text."""
    result, task = story.result, story.task
    noise = float(result.identification.noise.max())
    pairs = [
        ("robot", f"{story.robot.name}, {story.robot.n} joints, {story.robot.convention}"),
        ("rows", ", ".join(_counted(story))),
        (
            "points",
            f"{len(task.points)} spheres, sockets or anchors" if len(task.points) > 3 else ", ".join(task.points),
        ),
        ("zeros of lengths", ", ".join(task.datums)),
        ("certified distances", str(len(task.spacings)) if task.spacings is not None else ""),
        ("sessions", ", ".join(story.sessions) if len(task.sessions) > 1 else ""),
        (
            "model",
            f"{result.model}: {result.n_parameters} free parameters, {result.observability.rank} observable",
        ),
        ("updated from", "a prior model" if task.prior is not None else ""),
        ("scatter", "as predicted" if noise <= 1.0 else f"{noise:.1f} times what was predicted; every σ contains it"),
        ("assumed σ", _scaled(story)),
        ("ended", story.found.ended),
        *story.sources.items(),
    ]
    return [(name, text) for name, text in pairs if text]


def _scaled(story: FitStory) -> str:
    """The groups of parameters that deviate more than assumed, with the factor."""
    sizes = estimated(story.found.unknowns)  # of effects: their scale is estimated anyway
    factors = {
        name: by for name, by in story.result.identification.prior_scale.items() if name not in sizes and by > 1.0
    }
    words = [f"{group}: the data show {factor:.1f} times as much" for group, factor in factors.items()]
    return ", ".join(words)


def _counted(story: FitStory) -> list[str]:
    counts: dict[type[Measured], int] = {}
    for block in story.task.rows.blocks:
        counts[type(block)] = counts.get(type(block), 0) + len(block)
    return [f"{count} {kind.many if count > 1 else kind.one}" for kind, count in counts.items() if count]


def ladder(story: FitStory) -> list[Section]:
    """The models that were tried, in order of extension; empty if there was no choice."""
    return [
        {
            "model": step.model,
            "error": f"{step.error_mm:.3f}",
            "gain": with_sigma(step.gain_mm, step.standard_error_mm) if step.standard_error_mm else "",
            "outcome": "kept" if step.kept else "not kept",
            "kept": step.kept,
        }
        for step in story.result.ladder
    ]
