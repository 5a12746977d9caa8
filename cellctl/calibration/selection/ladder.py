"""Which model terms the rows support: from registration to geometry, then effect by effect.

A term is kept only if held-out rows gain by more than the standard error of that gain. These are rows of the fit
(cross-validation): the rows that judge the result have no influence on it. If most predictions are needed outside the
measured joints, the ends of the joint ranges decide between nominal, geometry and more.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Self, final

import numpy as np

from cellctl.calibration.effects import Effect, ResidualModel, in_order, kinds
from cellctl.calibration.estimation.evidence import Factor
from cellctl.calibration.estimation.identify import Weights, certain, identify_kept, nominal_start
from cellctl.calibration.estimation.progress import Progress, silent
from cellctl.calibration.estimation.task import Task
from cellctl.calibration.model.parameter import Group
from cellctl.calibration.model.unknowns import GEOMETRY
from cellctl.calibration.rows.row_blocks import RowBlocks
from cellctl.calibration.selection.cross_validation import Folded
from cellctl.calibration.selection.folds import end_folds, judging, random_folds
from cellctl.calibration.selection.model_error import carried
from cellctl.calibration.selection.remainder import remainder, shifts_of_tcp
from cellctl.kinematics import Bools, Floats

WORTH = 0.01
"""A gain below this share of the previous distance does not justify a term, even if it is significant."""

SHOWN = 0.25
"""A band of a joint's harmonics that moves the rows by less than this share of their noise is left out."""

WORTH_ENDS = 0.1
"""The same for a model with fewer terms, at the ends of the joint ranges, where errors are few and similar."""


@final
@dataclass(frozen=True, slots=True)
class Step:
    """A model that was tried: its mean error on held-out rows of the fit, mm; the gain over the best model before, and
    its standard error, mm; whether it was kept.
    """

    model: str
    error_mm: float
    gain_mm: float = 0.0
    standard_error_mm: float = 0.0
    kept: bool = False


@final
@dataclass(frozen=True, eq=False)
class Climbed:
    """The task with the terms that were kept, its noise and prior scales, and the steps tried."""

    task: Task
    weights: Weights | None
    steps: tuple[Step, ...]


@final
@dataclass(frozen=True, eq=False)
class _Model:
    """A candidate model: names of its groups, noise and prior scales, held-out errors (N,), mm."""

    groups: tuple[Group, ...]
    logs: Mapping[Factor, float]
    errors: Floats

    @property
    def name(self) -> str:
        return "+".join(self.groups) or "registration"


def climb(task: Task, rows: RowBlocks, progress: Progress = silent, *, outside: bool = False) -> Climbed:
    """`task` with the terms that `rows` (inliers) support, and the steps tried.

    outside: whether most predictions are needed outside the measured joints.
    """
    rows = rows.pick(judging(len(rows)))
    last = [effect for effect in task.candidates or () if effect.chosen == "by held-out rows"]
    first = tuple(effect for effect in task.candidates or () if effect not in last)
    ladder = _Ladder.of(replace(task, candidates=None), first, rows)
    nominal = ladder.tried((), {})
    geometry = ladder.tried((GEOMETRY,), nominal.logs)
    steps = [Step(nominal.name, float(nominal.errors.mean()), kept=True), _step(nominal, geometry)]
    if not steps[-1].kept:  # effects need geometry
        return Climbed(ladder.task_of(nominal), None, tuple(steps))
    best, waiting = geometry, [effect.group for effect in first]
    while waiting:
        missed: list[Group] = []
        again = False
        for number, group in enumerate(waiting):
            progress(group, len(steps) / (len(steps) + len(waiting) - number + 1))
            wider = ladder.tried(_ordered((*best.groups, group)), best.logs)
            steps.append(_step(best, wider))
            if steps[-1].kept:
                best, again = wider, bool(missed)
            else:
                missed.append(group)
        waiting = missed if again else []  # a later term may make an omitted one significant
    if outside:  # a residual model of these postures says nothing there
        best = ladder.best_at_the_ends([best, geometry, nominal])
        last = []
    for effect in last:
        progress(effect.group, len(steps) / (len(steps) + 1))
        fitted = ladder.with_fitted(effect, best)
        if fitted is not None:
            wider = fitted.tried(_ordered((*best.groups, effect.group)), best.logs)
            steps.append(_step(best, wider))
            ladder, best = (fitted, wider) if steps[-1].kept else (ladder, best)
    return Climbed(ladder.task_of(best), ladder.weights(best) if best.groups else None, tuple(steps))


def _step(before: _Model, tried: _Model) -> Step:
    gain = before.errors - tried.errors
    error = float(gain.std(ddof=1) / np.sqrt(gain.size)) if gain.size > 1 else np.inf
    pays = bool(gain.mean() > max(error, WORTH * float(before.errors.mean())))
    return Step(tried.name, float(tried.errors.mean()), float(gain.mean()), error, pays)


def _ordered(groups: tuple[Group, ...]) -> tuple[Group, ...]:
    return tuple(sorted(groups, key=lambda group: (GEOMETRY, *kinds()).index(group)))


@final
@dataclass(frozen=True, eq=False)
class _Ladder:
    """All terms that may be tried as one linearised problem; every model is a part of it."""

    task: Task
    candidates: tuple[Effect, ...]
    rows: RowBlocks
    folded: Folded
    groups: Any
    registering: Bools

    @classmethod
    def of(cls, task: Task, candidates: tuple[Effect, ...], rows: RowBlocks) -> Self:
        """Linearised about the fit of geometry alone."""
        found = identify_kept(task, rows)[1].found
        whole = task.with_effects((*task.model.effects, *candidates))
        unknowns = nominal_start(whole, rows)
        registering = whole.registration(unknowns)
        folded = Folded.of(unknowns, carried(found, unknowns), rows, certain(task), random_folds(rows.q), registering)
        groups = np.array(unknowns.groups)[unknowns.free]
        return cls(task, candidates, rows, folded, groups, registering[unknowns.free])

    def with_fitted(self, effect: Effect, best: _Model) -> _Ladder | None:
        """With a residual model too, its settings chosen for what `best` leaves; None where the rows do not support
        it.
        """
        assert isinstance(effect, ResidualModel)
        kept = self._columns(best.groups)
        prior = replace(self.folded.system.restricted(kept), numbers={}).posterior(best.logs)
        shifts = shifts_of_tcp(self.task, self.rows)
        fitted = effect.fitted_to(remainder(self.rows, self.folded.linear, np.flatnonzero(kept), prior, shifts))
        return None if fitted is None else _Ladder.of(self.task, (*self.candidates, fitted), self.rows)

    def tried(self, groups: tuple[Group, ...], begin: Mapping[Factor, float]) -> _Model:
        """The model of these terms on the held-out rows."""
        kept = self._columns(groups)
        logs, _ = self.folded.system.restricted(kept).tuned(begin)
        return _Model(groups, logs, self.folded.predicted(kept, logs).errors)

    def best_at_the_ends(self, models: list[_Model]) -> _Model:
        """The first of `models`, unless another predicts the ends of the joint ranges better from the other rows."""
        ends = end_folds(self.rows.q)
        if not ends:
            return models[0]
        outer = self.folded.with_folds(ends)
        errors = [outer.predicted(self._columns(model.groups), model.logs).errors for model in models]
        best = 0
        for place in range(1, len(models)):
            gain = errors[best] - errors[place]
            best = place if gain.mean() > WORTH_ENDS * errors[best].mean() else best
        return models[best]

    def task_of(self, model: _Model) -> Task:
        """The task of a model."""
        if not model.groups:
            return replace(self.task, groups=frozenset())
        kept = [self._with_what_shows(effect, model) for effect in self.candidates if effect.group in model.groups]
        return replace(self.task.with_effects(in_order([*self.task.model.effects, *kept])), groups=None)

    def _with_what_shows(self, effect: Effect, model: _Model) -> Effect:
        """A residual model without the bands that are too small to show in the noise of the rows."""
        bands = dict.fromkeys(parameter.band for parameter in effect.parameters if parameter.band)
        if not isinstance(effect, ResidualModel) or not bands:
            return effect
        system = self.folded.system
        squares = sum(np.diag(n.square) * np.exp(-2.0 * model.logs.get(f, 0.0)) for f, n in system.numbers.items())
        shown = np.asarray(squares) / sum(normal.count for normal in system.numbers.values())
        place = {name: number for number, (name, _) in enumerate(system.loose)}
        large = {
            band
            for band in bands
            if np.sum(shown[system.groups == place[band]]) * np.exp(2.0 * model.logs.get((band, 0), 0.0)) > SHOWN**2
        }
        return effect.reduced(large)

    def weights(self, model: _Model) -> Weights:
        """Its noise and prior scales."""
        return Weights.of(self.rows, {factor: float(np.exp(log)) for factor, log in model.logs.items()})

    def _columns(self, groups: tuple[Group, ...]) -> Bools:
        """The unknowns (F,) of a model with these terms; those that `task` always has belong to geometry."""
        added = {effect.group for effect in self.candidates}
        mine = ~np.isin(self.groups, list(added - set(groups)))
        return np.asarray(mine if GEOMETRY in groups else self.registering)
