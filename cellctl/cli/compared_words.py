"""Two compared runs as text."""

from __future__ import annotations

from collections.abc import Iterator

from cellctl.operations.comparing_models import ModelDifference, ParameterChange
from cellctl.operations.comparing_runs import ComparedFigure, RunComparison
from cellctl.report.figures import fixed, with_sigma

_SHOWN = 12
"""Maximum number of parameters shown, those with the largest differences; `--json` has all."""


def compared_words(found: RunComparison) -> Iterator[str]:
    """The comparison, line by line; facts that are the same are shown once."""
    yield f"a: {found.a}"
    yield f"b: {found.b}"
    for fact in found.facts:
        yield f"  {fact.name:16} {fact.a}" + ("" if fact.same else f"  →  {fact.b}")
    yield from (f"  {note}" for note in found.notes)
    for figure in found.figures:
        yield f"  {figure.name:16} {fixed(figure.a)} → {fixed(figure.b)} mm{_difference(figure)}"
    if found.models is None:
        yield f"  No parameters are compared: {found.why_not}."
        return
    yield from _of_models(found.models)


def _of_models(models: ModelDifference) -> Iterator[str]:
    yield f"  {models.sentence}"
    if models.tcp_rms_mm is not None:
        yield (
            f"  TCPs of the two models: {fixed(models.tcp_rms_mm)} mm apart (RMS; max {fixed(models.tcp_max_mm)}), "
            f"with base and tool registered; σ explains {fixed(models.tcp_sigma_mm)} mm."
        )
    yield from (f"  Not compared: {each}." for each in models.left_out)
    for change in models.parameters[:_SHOWN]:
        yield f"    {change.label:12} {fixed(change.a, 4)} → {fixed(change.b, 4)} {change.unit}{_difference(change)}"
    if len(models.parameters) > _SHOWN:
        yield f"    and {len(models.parameters) - _SHOWN} parameters with smaller differences: --json has all"


def _difference(each: ComparedFigure | ParameterChange) -> str:
    if each.difference is None:
        return ""
    if each.sigma is None:
        return f", {fixed(each.difference, 4)} (σ not known)"
    return f", {with_sigma(each.difference, each.sigma)}{', significant' if each.significant else ''}"
