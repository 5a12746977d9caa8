"""The sections about the model: parameters, places, correlation, what was not seen, how sure it is."""

from __future__ import annotations

from typing import Any

from cellctl.report.fit import correlation as correlations
from cellctl.report.fit import places
from cellctl.report.fit.region import RegionSigma, figures, region_picture
from cellctl.report.fit.story import FitStory
from cellctl.report.fit.table import coefficients, groups, held
from cellctl.report.numbers import percent
from cellctl.report.words import Reason, reasons

Section = dict[str, Any]

_LONG = 90
"""Letters of a combination from which on it is folded away."""


def parameters(story: FitStory) -> Section:
    """The table, group by group; places of base, tool and points; what was held."""
    shown = groups(story)
    points = places.points(story)
    return {
        "groups": [
            {
                "title": group.title,
                "folded": group.folded,
                "lines": [(line, percent(line.share), f"{max(0.0, 100.0 * line.share):.1f}") for line in group.lines],
            }
            for group in shown
        ],
        "any_wide": any(line.wide for group in shown for line in group.lines),
        "held": held(story),
        "coefficients": coefficients(story),
        "placements": places.placements(story),
        "points": points,
        "planes": places.planes(story),
        "datums": places.datums(story),
        "many_points": len(points) > places.MANY,
    }


def correlation(story: FitStory) -> Section | None:
    """Picture and strongest pairs; None for fewer than two parameters."""
    symbols, matrix = correlations.correlation(story)
    if len(symbols) < 2:
        return None
    return {
        "picture": correlations.correlation_picture(symbols, matrix),
        "strongest": correlations.strongest(symbols, matrix),
        "strong": correlations.count_strong(matrix),
        "shown": min(len(symbols), correlations.MOST),
        "all": len(symbols),
        "limit": f"{correlations.STRONG:g}",
    }


def unseen(story: FitStory) -> list[tuple[Reason, list[str], list[str]]]:
    """Why some combinations could not be seen, and which: those of few words, those of many."""
    found = [(reason, reason.phrases) for reason in reasons(story.result.summary())]
    return [
        (reason, [each for each in phrases if len(each) <= _LONG], [each for each in phrases if len(each) > _LONG])
        for reason, phrases in found
    ]


def region(story: FitStory, sigma: RegionSigma) -> Section:
    """How sure the model is over the joints."""
    used = story.readings[story.used]
    return {
        "figures": figures(sigma),
        "pictures": region_picture(story, sigma),
        "region": list(zip(story.joints, used.min(axis=0).tolist(), used.max(axis=0).tolist(), strict=True)),
    }
