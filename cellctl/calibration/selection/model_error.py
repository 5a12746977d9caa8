"""Whether rows show that a model is incomplete, and held-out rows support a residual model.

Of several terms that are tried, each would be kept by chance in 16 of 100 cases at one standard error of its gain, in 2
of 100 at two (one-sided normal distribution). That is for each term: one of four terms of no effect would be kept in 50
of 100 searches. A term of no effect does worse in fact, as its estimated amounts add their own variance. Random folds
only show that a function interpolates. Whether it also holds beyond the rows is seen where the first or the last fifth
of a joint's range is held out: a spurious function is often far off there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Self, TypeAlias, final

import numpy as np

from cellctl.calibration.effects import EffectInputs, ResidualModel, functions, in_order, kinds
from cellctl.calibration.folds import FIFTH, end_folds
from cellctl.calibration.model.learnt_map import learnt_maps
from cellctl.calibration.model.parameter import Group
from cellctl.calibration.model.postures import Postures
from cellctl.calibration.model.unknowns import Unknowns
from cellctl.calibration.problem.task import Task
from cellctl.calibration.rows import Rows
from cellctl.calibration.rows.row_blocks import RowBlocks
from cellctl.calibration.selection.cross_validation import Folded
from cellctl.calibration.solver.estimate import Estimate
from cellctl.calibration.solver.evidence import Factor, System
from cellctl.kinematics import Bools, Floats

WORTH = 0.01
"""A gain below this share of the previous distance does not justify a term, even if it is significant."""

STANDARD_ERRORS = 2.0
"""A residual model needs a gain of so many of its standard errors; a physical effect, with physical bounds, of one."""

WORSE_AT_END = 1.2
"""The mean error of held-out rows at an end of a joint's range may be this many times that without the residual
model: it returns to its prior there, which adds some variance even where it holds; one that fails is off by factors."""

Terms: TypeAlias = tuple[Bools, Mapping[Factor, float]]
"""A model: which of the unknowns (F,) it has, and its logarithms of noise and prior scales."""


@final
@dataclass(frozen=True, slots=True)
class Gain:
    """What a term gains in held-out rows: mean and standard error, mm. needed: of how many standard errors it has to
    be. worth: the least gain that counts, mm.

    error = s/√N, s the standard deviation of the N paired differences, as if rows were independent. R repeats of a
    posture have the same error of the model: the standard error is then too small, by up to √R.
    """

    mean: float
    error: float
    needed: float
    worth: float

    @classmethod
    def of(cls, before: Floats, after: Floats, group: Group = "") -> Self:
        """From the errors (N,), mm, of held-out rows without and with the term `group`."""
        gain = before - after
        error = float(gain.std(ddof=1) / np.sqrt(gain.size)) if gain.size > 1 else np.inf
        needed = STANDARD_ERRORS if group in functions() else 1.0
        return cls(float(gain.mean()), error, needed, WORTH * float(before.mean()))

    @property
    def significant(self) -> bool:
        """Whether it is larger than chance explains, and worth a term."""
        return self.mean > max(self.needed * self.error, self.worth)


def worst_end(folded: Folded, q: Floats, before: Terms, after: Terms) -> float:
    """The largest ratio of mean errors, `after` to `before`, of the fifth of the rows at q (N, n), rad, at one end of a
    joint's range, held out; 0 where no joint has rows enough at an end.

    Each ratio is less one standard error: of seven rows (a fifth of 36) it is known to 0.3 only, and one of twelve
    ends would be above any limit by chance. The largest of twelve is still: with seven rows at an end a model that is
    as good as the one before fails in 15 to 35 of 100 draws (simulated normal errors), with twenty in at most 12.
    """
    ends = end_folds(q, FIFTH)
    if not ends:
        return 0.0
    outer = folded.with_folds(ends)
    without, with_it = outer.predicted(*before).errors, outer.predicted(*after).errors
    stops = np.cumsum([len(end) for end in ends])[:-1]
    return max(_ratio(*pair) for pair in zip(np.split(without, stops), np.split(with_it, stops), strict=True))


def _ratio(before: Floats, after: Floats) -> float:
    """Mean of `after` over that of `before` (N,), less its standard error (delta method for a ratio of means)."""
    if len(before) < 2:
        return 0.0
    mean = max(float(before.mean()), 1e-12)
    ratio = float(after.mean()) / mean
    return ratio - float((after - ratio * before).std(ddof=1)) / (mean * float(np.sqrt(len(before))))


ROWS_AT_LEAST = 10
"""Of a residual model: fewer rows tell no function of six joints from scatter."""

SHOWN = 2.0
"""A residual model has to raise the logarithm of the evidence by this: seven times as probable. A spurious one only
makes σ larger; if a necessary one is missing, σ is too small.
"""


def without_functions(task: Task) -> Task:
    """`task` without residual models; unchanged where they belong to a prior model."""
    if task.prior is not None:
        return task
    return task.with_effects(tuple(effect for effect in task.model.effects if not isinstance(effect, ResidualModel)))


def may_join(task: Task) -> list[type[ResidualModel]]:
    """Residual models that may be added: only if the robot's geometry is identified, without a prior model, and there
    is no error map to learn what it leaves.
    """
    if task.prior is not None or task.groups is not None or learnt_maps(task.model):
        return []
    there = {effect.group for effect in task.model.effects}
    of_evidence = [kind for kind in kinds().values() if kind.chosen == "by evidence" and kind.group not in there]
    return [kind for kind in of_evidence if issubclass(kind, ResidualModel)]


def with_kind(task: Task, kind: type[ResidualModel], rows: RowBlocks) -> Task | None:
    """`task` with a residual model of this kind added, made from `rows`; None where they cannot determine it."""
    made = kind.of_inputs(EffectInputs(task.model.chain, Postures(rows.q)))
    return None if made is None else task.with_effects(in_order([*task.model.effects, made]))


def scales_with(
    group: Group, found: Estimate, wider: Unknowns, rows: RowBlocks, certified: list[Rows], scales: dict[Factor, float]
) -> dict[Factor, float] | None:
    """Noise and prior scales with the residual model `group` that `wider` adds to what was `found` with `scales`; None
    where the rows are hardly more probable with it.
    """
    system = System.of(wider, carried(found, wider), rows, certified)
    logs = {factor: float(np.log(value)) for factor, value in scales.items()}
    gain, tuned = system.gain((group, 0), logs)
    if gain < SHOWN:
        return None
    return {factor: float(np.exp(value)) for factor, value in tuned.items()}


def carried(found: Estimate, wider: Unknowns) -> Floats:
    """The deviations (P,) of `found` for unknowns with additional amounts, which are 0."""
    deviations = np.zeros(len(wider.names))
    deviations[_places(found.unknowns, wider)] = found.deviations
    return deviations


def widened(found: Estimate, wider: Unknowns) -> Estimate:
    """`found` for unknowns with additional amounts, held at 0."""
    places, given = _places(found.unknowns, wider), found.unknowns
    free = np.zeros(len(wider.names), bool)
    free[places] = given.free
    covariance = np.zeros((len(free),) * 2)
    covariance[np.ix_(places, places)] = found.covariance
    pinned = None
    if given.pinned is not None:
        pinned = np.zeros((len(given.pinned), len(free)))
        pinned[:, places] = given.pinned
    unknowns = replace(wider, free=free, pinned=pinned)
    return replace(found, unknowns=unknowns, deviations=carried(found, wider), covariance=covariance)


def _places(unknowns: Unknowns, wider: Unknowns) -> Any:
    place = {name: number for number, name in enumerate(wider.names)}
    return [place[name] for name in unknowns.names]
