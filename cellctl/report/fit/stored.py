"""A fit as the two rows that a run stores of it, from which its page and the run's page are drawn."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from cellctl.records import IdentificationRow, ResidualsRow
from cellctl.report.fit import places
from cellctl.report.fit.advice import advice
from cellctl.report.fit.correlation import correlation
from cellctl.report.fit.head import head
from cellctl.report.fit.hints import hints
from cellctl.report.fit.region import RegionSigma, curves, figures
from cellctl.report.fit.residuals import Residuals, listed
from cellctl.report.fit.residuals_of_fit import residuals_of
from cellctl.report.fit.story import FitStory
from cellctl.report.fit.table import coefficients, groups, held
from cellctl.report.numbers import percent
from cellctl.report.words import reasons

Section = dict[str, Any]

_LEFT_OUT = (("outliers", "left out"), ("rejected", "not usable"), ("test_outliers", "held out, counted"))


def identification_rows(story: FitStory) -> tuple[ResidualsRow, IdentificationRow]:
    """The data of a fit that a run stores."""
    rows, region = residuals_of(story), RegionSigma.of(story)
    result = story.result
    before, after = _errors(story, rows)
    labels, matrix = correlation(story)
    rms, greatest = figures(region)
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
        along_joint=tuple((listed(at), listed(sigma)) for at, sigma in curves(story, region)),
        hints=tuple(hints(story)),
        advice=advice(story, region),
        left_out=tuple(_left_out(story)),
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
        "placements": places.placements(story),
        "points": places.points(story),
        "planes": places.planes(story),
        "datums": places.datums(story),
    }


def _left_out(story: FitStory) -> list[Section]:
    """Rows that the fit did not use, or held-out outliers, by line with the reason."""
    return [
        {"line": row["line"], "number": story.numbers.get(row["line"], ""), "kind": words, "reason": row["reason"]}
        for name, words in _LEFT_OUT
        for row in story.said.get(name, [])
    ]
