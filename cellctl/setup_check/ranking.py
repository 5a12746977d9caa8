"""Ranking: which hypotheses bring nominal to the rows, and which of these are as good as the best."""

from __future__ import annotations

import re
from collections.abc import Iterable

import numpy as np

from cellctl.calibration.rows import PlaneRows
from cellctl.setup_check.hypothesis import Hypothesis
from cellctl.setup_check.misfit import EXPLAINED, SAMPLE, SCREEN, Misfit, misfit, steps_of

BETTER = 4.0
"""A hypothesis has to bring nominal nearer to its rows by this factor."""

EQUAL = 1.5
"""Hypotheses with up to this multiple of the best one's residual are equally good: these rows do not decide."""

FLAT = 0.05
"""Touches on planes whose least extent is smaller than this share of their greatest lie in one plane."""

SAME_DEG = 2.0
"""Offsets nearer than this to each other are one."""

PROMISING = 8
"""Most hypotheses that are judged, selected by a few rows."""

NAMED = 4
"""Most explanations that are reported."""


def explanations(proposed: Iterable[Hypothesis], nominal: Misfit) -> list[tuple[Hypothesis, Misfit]]:
    """The hypotheses that explain the distance of `nominal` from the rows, with the misfit that each leaves. The best
    and its equals, the simplest first.
    """
    explaining = []
    for hypothesis in _screened(proposed, nominal):
        sample = hypothesis.setup.thinned(SAMPLE)
        after = misfit(sample).with_prediction(sample)
        if after.ratio <= EXPLAINED and nominal.ratio >= BETTER * after.ratio:
            explaining.append((hypothesis, after))
    return _equally_good(explaining)


def _screened(proposed: Iterable[Hypothesis], nominal: Misfit) -> list[Hypothesis]:
    """Those with the least residual at a few rows, of all that clearly reduce it."""
    sized = []
    for hypothesis in proposed:
        size = misfit(hypothesis.setup.thinned(SCREEN), rounds=2).size
        if size < nominal.size / 2.0 and not _flat(hypothesis):
            sized.append((size, hypothesis))
    steps = steps_of(np.array([size for size, _ in sized]))
    order = sorted(range(len(sized)), key=lambda place: (steps[place], sized[place][1].complexity, place))
    return [sized[place][1] for place in order[:PROMISING]]


def _flat(hypothesis: Hypothesis) -> bool:
    """Whether only planes were touched, and all touches lie in one plane: a robot that only moves in a plane fits any
    planes, and would explain all rows.
    """
    task = hypothesis.setup.task
    if task.rows.kinds != {PlaneRows}:
        return False
    tcps = np.concatenate([task.model.tcp(block.postures) for block in task.rows.blocks])
    extents = np.linalg.svd(tcps - tcps.mean(axis=0), compute_uv=False)
    return bool(extents[-1] < FLAT * extents[0])


def _equally_good(explaining: list[tuple[Hypothesis, Misfit]]) -> list[tuple[Hypothesis, Misfit]]:
    """The best and its equals, the simplest first; for each file only those with the fewest changes."""
    best = min((after.size for _, after in explaining), default=0.0)
    equal = [(hypothesis, after) for hypothesis, after in explaining if after.size <= EQUAL * best]
    kept: list[tuple[Hypothesis, Misfit]] = []
    for hypothesis, after in sorted(equal, key=lambda pair: (pair[0].complexity, pair[1].size)):
        if not any(_simpler(other, hypothesis) or _same(hypothesis, other) for other, _ in kept):
            kept.append((hypothesis, after))
    return kept[:NAMED]


def _simpler(other: Hypothesis, hypothesis: Hypothesis) -> bool:
    """Whether `other` makes fewer changes, in no other file, or the same changes in a simpler way."""
    if _keys(other) == _keys(hypothesis) and other.complexity < hypothesis.complexity:
        return True
    sources = {change.source for change in hypothesis.changes}
    return {change.source for change in other.changes} <= sources and len(other.changes) < len(hypothesis.changes)


def _same(one: Hypothesis, other: Hypothesis) -> bool:
    """Whether two hypotheses are the same, except for the exact value of an angle."""
    if _keys(one) != _keys(other):
        return False
    apart = np.abs((one.setup.joints.offset - other.setup.joints.offset + 180.0) % 360.0 - 180.0)
    words = [[re.sub(r"[\d.]+°", "", change.what) for change in each.changes] for each in (one, other)]
    return words[0] == words[1] and bool(np.all(apart < SAME_DEG))


def _keys(hypothesis: Hypothesis) -> list[tuple[str | int, ...]]:
    return [change.key for change in hypothesis.changes]
