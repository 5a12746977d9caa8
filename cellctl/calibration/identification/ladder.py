"""Which model terms the rows support: from registration to geometry, then effect by effect, then what remains.

A term is kept only if held-out rows gain by more than the standard error of that gain (as in the one-standard-error
rule, Hastie, Tibshirani and Friedman 2009, section 7.10); a residual model needs two, and must not fail at the ends of
the joint ranges (`worst_end`). These are rows of the fit (cross-validation): the rows that judge the result have no
influence on it. If most predictions are needed outside the measured joints, the ends of the joint ranges decide
between nominal, geometry and more.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Self, final

import numpy as np

from cellctl.calibration.effects import Effect, ResidualModel, functions, in_order, kinds
from cellctl.calibration.folds import end_folds, judging, random_folds
from cellctl.calibration.identification.identify import Scales, fixed_rows, identify_kept, nominal_start
from cellctl.calibration.identification.learning import ALONG, TcpShift
from cellctl.calibration.identification.progress import Progress, silent
from cellctl.calibration.model.parameter import Group
from cellctl.calibration.model.residual_model import Remainder
from cellctl.calibration.model.unknowns import GEOMETRY
from cellctl.calibration.problem.task import Task
from cellctl.calibration.rows.row_blocks import RowBlocks
from cellctl.calibration.selection.cross_validation import Folded, Linear
from cellctl.calibration.selection.model_error import WORSE_AT_END, Gain, carried, worst_end
from cellctl.calibration.solver.evidence import Factor
from cellctl.kinematics import Bools, Floats

ROWS = 300
"""Rows that choose the settings of a field, at most: the time grows with their cube, and the settings hardly change."""


def shifts_of_tcp(task: Task, rows: RowBlocks) -> Floats:
    """How a shift of the TCP by 1 mm along each axis of the base changes the numbers of each row: (N, k, 3), in σ."""
    moved = task.with_effects((TcpShift(),))
    unknowns = nominal_start(moved, rows)
    only = unknowns.masked(unknowns.among(frozenset({TcpShift.group})))
    return Linear.about(only, np.zeros(len(only.names)), rows, ()).jacobian


def remainder(rows: RowBlocks, linear: Linear, at: Any, prior: tuple[Floats, Floats], shifts: Floats) -> Remainder:
    """Of N rows, for the model of the unknowns `at` (indices into those of `linear`).

    A row S e + J x (S its shifts) has the error e = −S⁺ r with covariance S⁺ J C Jᵀ S⁺ᵀ: what these unknowns may still
    explain, with C as known without the rows. Residuals of a fit would have lost that part, and be correlated by it.

    prior: inverse covariance (F, F) of these unknowns without the rows, and gradient (F,). shifts: see `shifts_of_tcp`.
    Rows in which no instrument measures a point (touches, sockets) are left out: the places of their own points take up
    a part of each smooth error.
    """
    singular = np.linalg.svd(shifts, compute_uv=False)
    whole = rows.of_instrument & (singular[:, -1] > ALONG * singular[:, 0])
    points = np.flatnonzero(whole) if shifts.shape[1] >= 3 else np.zeros(0, int)
    points = np.sort(np.random.default_rng(len(points)).permutation(points)[:ROWS])
    to_mm = np.linalg.pinv(shifts[points])
    columns = to_mm @ linear.jacobian[points][..., at]
    covariance = np.linalg.inv(prior[0])
    away = linear.residual[points] - linear.jacobian[points][..., at] @ (covariance @ prior[1])
    errors = -np.einsum("nak,nk->na", to_mm, away)
    return Remainder(rows.q[points], errors, np.einsum("naf,fg,mag->anm", columns, covariance, columns, optimize=True))


SHOWN = 0.25
"""A band of a joint's harmonics that moves the rows by less than this share of their noise is left out: √(s²
tr(JᵀJ)/n), the RMS over all n numbers, in their σ, of the band within its prior. It is then 6 % of their variance."""

WORTH_ENDS = 0.1
"""The same for a model with fewer terms, at the ends of the joint ranges, where errors are few and similar. No test:
one row is at the ends of several joints."""


@final
@dataclass(frozen=True, slots=True)
class Step:
    """A model that was tried: its mean error on held-out rows of the fit, mm; the gain over the best model before, and
    its standard error, mm; whether it was kept. worst_end: for a residual model with a significant gain, the largest
    ratio of errors with and without it at an end of a joint's range; 0 where that was not looked at.
    """

    model: str
    error_mm: float
    gain_mm: float = 0.0
    standard_error_mm: float = 0.0
    kept: bool = False
    worst_end: float = 0.0


@final
@dataclass(frozen=True, eq=False)
class Climbed:
    """The task with the terms that were kept, its noise and prior scales, and the steps tried."""

    task: Task
    scales: Scales | None
    steps: tuple[Step, ...]


@final
@dataclass(frozen=True, eq=False)
class _Model:
    """A candidate model: names of its groups, noise and prior scales, held-out errors (N,), mm. without: bands of
    residual models that it does not have.
    """

    groups: tuple[Group, ...]
    logs: Mapping[Factor, float]
    errors: Floats
    without: frozenset[str] = frozenset()

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
    steps = [Step(nominal.name, float(nominal.errors.mean()), kept=True), ladder.step(nominal, geometry, GEOMETRY)]
    if not steps[-1].kept:  # effects need geometry
        return Climbed(ladder.task_of(nominal), None, tuple(steps))
    best, waiting = geometry, [effect.group for effect in first]
    while waiting:
        missed: list[Group] = []
        again = False
        for number, group in enumerate(waiting):
            progress(group, len(steps) / (len(steps) + len(waiting) - number + 1))
            wider, step = ladder.extended(best, group)
            steps.append(step)
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
            wider, step = fitted.extended(best, effect.group)
            steps.append(step)
            ladder, best = (fitted, wider) if steps[-1].kept else (ladder, best)
    return Climbed(ladder.task_of(best), ladder.scales(best) if best.groups else None, tuple(steps))


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
        """Linearised about the fit of geometry alone, where all amounts are 0.

        Effects are linear in their amounts at nominal joints (decision 8), and J hardly changes with the links: one
        linearisation holds for every model of the ladder.
        """
        found = identify_kept(task, rows)[1].found
        whole = task.with_effects((*task.model.effects, *candidates))
        unknowns = nominal_start(whole, rows)
        registering = whole.registration_parameters(unknowns)
        folded = Folded.of(
            unknowns, carried(found, unknowns), rows, fixed_rows(whole), random_folds(rows.q), registering
        )
        groups = np.array(unknowns.groups)[unknowns.free]
        return cls(task, candidates, rows, folded, groups, registering[unknowns.free])

    def with_fitted(self, effect: Effect, best: _Model) -> _Ladder | None:
        """With a residual model too, its settings chosen for what `best` leaves; None where the rows do not support
        it.
        """
        assert isinstance(effect, ResidualModel)
        kept = self._columns(best)
        prior = replace(self.folded.system.restricted(kept), numbers={}).posterior(best.logs)
        shifts = shifts_of_tcp(self.task, self.rows)
        fitted = effect.fitted_to(remainder(self.rows, self.folded.linear, np.flatnonzero(kept), prior, shifts))
        return None if fitted is None else _Ladder.of(self.task, (*self.candidates, fitted), self.rows)

    def tried(
        self, groups: tuple[Group, ...], begin: Mapping[Factor, float], without: frozenset[str] = frozenset()
    ) -> _Model:
        """The model of these terms on the held-out rows."""
        model = _Model(groups, begin, np.zeros(0), without)
        logs, _ = self.folded.system.restricted(self._columns(model)).tuned(begin)
        return self._predicted(replace(model, logs=logs))

    def _predicted(self, model: _Model) -> _Model:
        """`model` with its errors on the held-out rows."""
        return replace(model, errors=self.folded.predicted(self._columns(model), model.logs).errors)

    def extended(self, best: _Model, group: Group) -> tuple[_Model, Step]:
        """`best` with the term `group`, and whether the rows support it. Bands of a residual model that are why it
        fails at an end of a joint's range are left out.
        """
        wider = self.tried(_ordered((*best.groups, group)), best.logs, best.without)
        step = self.step(best, wider, group)
        if step.worst_end > WORSE_AT_END:
            reduced = self._reduced(best, wider, group)
            return (wider, step) if reduced is None else (reduced, self.step(best, reduced, group))
        return wider, step

    def _reduced(self, best: _Model, wider: _Model, group: Group) -> _Model | None:
        """The most accurate of `wider` with fewer bands that does not fail at the ends; None where all do.

        They keep the noise and prior scales of `wider`: fewer bands with larger scales would fail in the same way.
        The best of about 2n + 1 models on the same rows has too small an error; its gain has to pass `Gain` all the
        same.
        """
        (effect,) = (each for each in self.candidates if each.group == group)
        fewer = effect.fewer_bands() if isinstance(effect, ResidualModel) else ()
        models = [replace(wider, without=wider.without | bands) for bands in fewer]
        held = [self._predicted(model) for model in models if self._worst_end(best, model) <= WORSE_AT_END]
        return min(held, key=lambda model: float(model.errors.mean()), default=None)

    def step(self, before: _Model, wider: _Model, group: Group) -> Step:
        """`wider`, which adds `group` to the model `before`, and whether the rows support it."""
        gain, end = Gain.of(before.errors, wider.errors, group), 0.0
        if gain.significant and group in functions():
            end = self._worst_end(before, wider)
        kept = gain.significant and end <= WORSE_AT_END
        return Step(wider.name, float(wider.errors.mean()), gain.mean, gain.error, kept, end)

    def _worst_end(self, before: _Model, wider: _Model) -> float:
        return worst_end(self.folded, self.rows.q, *((self._columns(each), each.logs) for each in (before, wider)))

    def best_at_the_ends(self, models: list[_Model]) -> _Model:
        """The first of `models`, unless another predicts the ends of the joint ranges better from the other rows."""
        ends = end_folds(self.rows.q)
        if not ends:
            return models[0]
        outer = self.folded.with_folds(ends)
        errors = [outer.predicted(self._columns(model), model.logs).errors for model in models]
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
        squares = sum(np.diag(n.JtJ) * np.exp(-2.0 * model.logs.get(f, 0.0)) for f, n in system.numbers.items())
        shown = np.asarray(squares) / sum(normal.count for normal in system.numbers.values())
        place = {name: number for number, (name, _) in enumerate(system.loose)}
        large = {
            band
            for band in bands
            if np.sum(shown[system.groups == place[band]]) * np.exp(2.0 * model.logs.get((band, 0), 0.0)) > SHOWN**2
        } - model.without
        return effect.reduced(large)

    def scales(self, model: _Model) -> Scales:
        """Its noise and prior scales."""
        return Scales.of(self.rows, {factor: float(np.exp(log)) for factor, log in model.logs.items()})

    def _columns(self, model: _Model) -> Bools:
        """The unknowns (F,) of a model; those that `task` always has belong to geometry."""
        added, system = {effect.group for effect in self.candidates}, self.folded.system
        left_out = [place for place, (name, _) in enumerate(system.loose) if name in model.without]
        mine = ~np.isin(self.groups, list(added - set(model.groups))) & ~np.isin(system.groups, left_out)
        return np.asarray(mine if GEOMETRY in model.groups else self.registering)
