"""What a run stores of a fit, and what its page shows: verdict and figures, parameters, hints; nothing is drawn."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from cellctl.calibration import Measured
from cellctl.calibration.solver.evidence import estimated
from cellctl.records import IdentificationRow, ResidualsRow
from cellctl.report.figures import fit_lines, percent, reasons, with_sigma
from cellctl.report.fit import _parameters as listed_parameters
from cellctl.report.fit._advice import advice, candidates, hints
from cellctl.report.fit._parameters import coefficients, correlation, groups, held
from cellctl.report.fit._region import RegionSigma, bound_in_words, curves, figures
from cellctl.report.fit._story import FitStory
from cellctl.report.fit.residuals import Residuals, listed, residuals_of

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
        ("nominal geometry", story.robot.geometry_source),
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


_LEFT_OUT = (("outliers", "left out"), ("rejected", "not usable"), ("test_outliers", "held out, counted"))


def identification_rows(story: FitStory) -> tuple[ResidualsRow, IdentificationRow]:
    """The data of a fit that a run stores."""
    rows, result = residuals_of(story), story.result
    region = None if np.isnan(result.predicted_volumetric_rms) else RegionSigma.of(story)
    blocks, skipped = candidates(story) if region else ([], [])
    before, after = _errors(story, rows)
    labels, matrix = correlation(story)
    rms, greatest = figures(region) if region else ({}, {})
    turns = np.array([model.chain.base_now[:3, :3] for model in story.found.state.models])
    return rows.stored(), IdentificationRow(
        head=head(story),
        joints=tuple(story.joints),
        sessions=tuple(story.sessions),
        one_frame=all(name != "base" for session in story.task.sessions[1:] for name in session.own),
        base_turns=listed(turns),
        before=listed(before),
        after=listed(after),
        held_out=bool(result.n_test),
        parameters=parameters(story),
        correlated=tuple(labels),
        correlation=listed(matrix),
        unobservable=tuple(asdict(reason) for reason in reasons(result.summary())),
        sigma_rms_mm=rms,
        sigma_max_mm=greatest,
        along_joint=tuple((listed(at), listed(sigma)) for at, sigma in (curves(story, region) if region else ())),
        hints=(*hints(story), *skipped),
        advice=advice(story, region, blocks) if region else None,
        left_out=tuple(_left_out(story)),
        distribution_free=bound_in_words(story),
    )


def _errors(story: FitStory, rows: Residuals) -> tuple[Any, Any]:
    """Errors before and after, mm: of the held-out rows, or, without such rows, of the fit's."""
    result = story.result
    if result.n_test:
        return (result.nominal_errors if result.prior_errors is None else result.prior_errors), result.test_errors
    before, after = rows.sizes
    return before[rows.fitted], after[rows.fitted]


def parameters(story: FitStory) -> Section:
    """The table, group by group; places of base, tool and points; held parameters."""
    shown = groups(story)
    return {
        "groups": [
            {
                "title": group.title,
                "folded": group.folded,
                "lines": [
                    {**asdict(line), "from_data": percent(line.share), "decided_by": line.decided_by}
                    for line in group.lines
                ],
            }
            for group in shown
        ],
        "held": held(story),
        "coefficients": coefficients(story),
        "placements": listed_parameters.placements(story),
        "points": listed_parameters.points(story),
        "planes": listed_parameters.planes(story),
        "datums": listed_parameters.datums(story),
    }


def _left_out(story: FitStory) -> list[Section]:
    """Rows that the fit did not use, or held-out outliers, by line with the reason."""
    return [
        {"line": row["line"], "number": story.numbers.get(row["line"], ""), "kind": words, "reason": row["reason"]}
        for name, words in _LEFT_OUT
        for row in story.said.get(name, [])
    ]
