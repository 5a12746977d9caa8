"""How much model the rows pay for: from registration to geometry, and on by one effect after another.

A step is kept only if rows that it did not see gain by more than the standard error of that gain. Judged within the
rows of the fit alone (cross-validation), so that the rows that judge the result have had no say in what it is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, TypeAlias, final

import numpy as np

from cellctl.calibration.effects import EFFECTS, Effect, Harmonics, find_ripple
from cellctl.calibration.estimate import Estimate
from cellctl.calibration.heldout import held_out_errors
from cellctl.calibration.identify import Weights, identify_kept
from cellctl.calibration.mixture import Mixture
from cellctl.calibration.progress import Progress, silent
from cellctl.calibration.task import Task
from cellctl.kinematics import Floats

FOLDS = 5
JUDGING = 1000
"""Rows that a step is judged by, at most: more would not change what they say, only take longer."""

NUMBERS_EACH = 3
"""Measured numbers for each unknown, without which a step is not even tried."""

WORTH = 0.005
"""A gain of a smaller share of the distance before is not worth a term, however sure it is."""

WAVES_AT_MOST = 30
RIPPLE = "ripple"

Rung: TypeAlias = Callable[[Mixture], Task]
"""A model: what is identified where it is made from these rows. Only ripple looks at them."""


@final
@dataclass(frozen=True, slots=True)
class Step:
    """A model that was tried: by how much rows unseen by it are nearer than by the model before, mm, the standard error
    of that, and whether it was kept. untried: why it was not tried, in words; empty where it was.
    """

    model: str
    gain_mm: float = 0.0
    standard_error_mm: float = 0.0
    kept: bool = False
    untried: str = ""


def climb(task: Task, rows: Mixture, progress: Progress = silent) -> tuple[Task, tuple[Step, ...]]:
    """`task` with as much model as `rows` pay for, all of which belong together, and what was tried."""
    fixed = replace(task, candidates=None)
    rows = rows.pick(_some(len(rows)))
    current: Rung = _always(replace(fixed, groups=frozenset()))
    errors = _unseen_errors(current, rows, current(rows))
    steps: list[Step] = []
    waiting = list(_wider(task))
    while waiting:
        missed: list[tuple[str, Callable[[Rung], Rung]]] = []
        kept = False
        for number, (name, wider) in enumerate(waiting):
            progress(name, len(steps) / (len(steps) + len(waiting) - number + 1))
            step, its_errors = _tried(wider(current), name, rows, errors)
            steps.append(step)
            if step.kept:
                current, errors, kept = wider(current), its_errors, bool(missed)
            elif name == "geometry":
                return current(rows), tuple(steps)  # without geometry there is nothing for an effect to build on
            elif not step.untried:
                missed.append((name, wider))
        waiting = missed if kept else []  # what was lost in the noise of something found after it is tried again
    return current(rows), tuple(steps)


def _wider(task: Task) -> Iterator[tuple[str, Callable[[Rung], Rung]]]:
    """What is tried one after another: its name, and how it widens the model kept so far."""
    yield "geometry", lambda current: _changed(current, lambda so_far: replace(so_far, groups=None))
    for effect in task.candidates or ():
        yield effect.group, _adding(effect)
    if any(isinstance(effect, Harmonics) for effect in task.candidates or ()):
        yield RIPPLE, _rippling


def _always(task: Task) -> Rung:
    return lambda rows: task


def _changed(current: Rung, change: Callable[[Task], Task]) -> Rung:
    return lambda rows: change(current(rows))


def _adding(effect: Effect) -> Callable[[Rung], Rung]:
    return lambda current: _changed(current, lambda so_far: _with_effect(so_far, effect))


def _rippling(current: Rung) -> Rung:
    return lambda rows: _with_ripple(current(rows), rows)


def _with_effect(task: Task, effect: Effect) -> Task:
    """`task` with `effect` in place of any of its group."""
    others = [each for each in task.model.effects if each.group != effect.group]
    effects = sorted([*others, effect], key=lambda each: EFFECTS.index(each.group))
    return task.with_effects(tuple(effects))


def _with_ripple(task: Task, rows: Mixture) -> Task:
    """`task` with the waves that a fit to `rows` leaves."""
    so_far = next((effect for effect in task.model.effects if isinstance(effect, Harmonics)), None)
    waves = _waves(identify_kept(task, rows, Weights.as_said(rows))[1].found, rows)
    if not waves:
        return task
    orders = so_far.orders if so_far else ()
    return _with_effect(task, Harmonics(task.model.n, orders=orders, ripple=waves))


def _waves(found: Estimate, rows: Mixture) -> tuple[tuple[int, int], ...]:
    """Joint and waves per turn of each ripple that stands out of what `found` leaves of `rows`."""
    state, free = found.state, np.flatnonzero(found.unknowns.free)
    names = found.unknowns.names
    joints = np.array([names.index(f"theta{joint + 1}") for joint in range(state.model.n)])
    width = int(rows.numbers.max())
    columns, beside = np.zeros((len(rows), width, len(joints))), np.zeros((len(rows), width, free.size))
    left = np.zeros((len(rows), width))
    for block, mine, _ in rows.parts():
        moved = block.jacobian(state) / block.sigma[..., None]
        place = np.s_[mine, : block.sigma.shape[1]]
        columns[place], beside[place] = moved[..., joints], moved[..., free]
        left[place] = -block.residual(state) / block.sigma
    at_most = min(WAVES_AT_MOST, (rows.size // NUMBERS_EACH - free.size) // 2)
    return find_ripple(columns, left, rows.q, beside, at_most=max(at_most, 0))


def _tried(rung: Rung, name: str, rows: Mixture, before: Floats) -> tuple[Step, Floats]:
    task = rung(rows)
    unknowns = task.unknowns(task.start(rows))
    count = int(np.count_nonzero(task.identification(unknowns)))
    if name != "geometry" and rows.size < NUMBERS_EACH * count:
        return Step(name, untried=f"{rows.size} numbers are too few for {count} unknowns"), before
    if name == RIPPLE and not any(isinstance(each, Harmonics) and each.ripple for each in task.model.effects):
        return Step(name, untried="no wave stands out of the scatter"), before
    errors = _unseen_errors(rung, rows, task)
    gain = before - errors
    standard_error = float(gain.std(ddof=1) / np.sqrt(gain.size))
    pays = gain.mean() > max(standard_error, WORTH * float(before.mean()))
    return Step(name, float(gain.mean()), standard_error, bool(pays)), errors


def _unseen_errors(rung: Rung, rows: Mixture, whole: Task) -> Floats:
    """Each row's distance (N,), mm, from a model that was made without it, but for the weights of noise and tolerances:
    they are those of `whole`, which is made from all rows.
    """
    order = np.random.default_rng(len(rows)).permutation(len(rows))
    errors, weights = np.zeros(len(rows)), identify_kept(whole, rows)[1].weights
    for part in np.array_split(order, min(FOLDS, len(rows))):
        test = np.sort(part)
        others = rows.pick(np.setdiff1d(np.arange(len(rows)), test))
        task = rung(others)
        _, weighed = identify_kept(task, others, weights)
        errors[test] = held_out_errors(task, weighed.found, others, rows.pick(test))
    return errors


def _some(count: int) -> Any:
    """At most `JUDGING` of so many rows, the same ones each time."""
    return np.sort(np.random.default_rng(count).permutation(count)[:JUDGING])
