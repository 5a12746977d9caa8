"""How much model the rows pay for: from registration to geometry, and on by one effect after another.

A step is kept only if rows that it did not see gain by more than the standard error of that gain. Judged within the
rows of the fit alone (cross-validation), so that the rows that judge the result have had no say in what it is.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np

from cellctl.calibration.effects import EFFECTS, Effect
from cellctl.calibration.heldout import held_out_errors
from cellctl.calibration.identify import identify_kept, rows_together
from cellctl.calibration.mixture import Mixture
from cellctl.calibration.task import Task
from cellctl.kinematics import Floats

FOLDS = 5
JUDGING = 1500
"""Rows that a step is judged by, at most: more would not change what they say, only take longer."""

NUMBERS_EACH = 3
"""Measured numbers for each unknown, without which a step is not even tried."""


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


def climb(task: Task, fit: Any) -> tuple[Task, tuple[Step, ...]]:
    """`task` with as much model as the rows at `fit` pay for, and what was tried. A task with a fixed model stays."""
    if task.candidates is None:
        return task, ()
    kept = task.rows.pick(fit)
    kept = kept.pick(rows_together(replace(task, candidates=None), kept)[0])
    kept = kept.pick(_some(len(kept)))
    current = replace(task, candidates=None, groups=frozenset())
    errors, steps = _unseen_errors(current, kept), []
    for wider, name in _wider(task):
        step, its_errors = _tried(wider(current), name, kept, errors)
        steps.append(step)
        if step.kept:
            current, errors = wider(current), its_errors
        elif len(steps) == 1:
            break  # without geometry there is nothing for an effect to build on
    return current, tuple(steps)


def _wider(task: Task) -> Iterator[tuple[Any, str]]:
    """What is tried one after another: how it widens the model kept so far, and its name."""
    yield lambda current: replace(current, groups=None), "geometry"
    for effect in task.candidates or ():
        yield _adding(effect), effect.group


def _adding(effect: Effect) -> Any:
    def with_it(current: Task) -> Task:
        effects = sorted((*current.model.effects, effect), key=lambda each: EFFECTS.index(each.group))
        return current.with_effects(tuple(effects))

    return with_it


def _tried(task: Task, name: str, rows: Mixture, before: Floats) -> tuple[Step, Floats]:
    unknowns = task.unknowns(task.start(rows))
    count = int(np.count_nonzero(task.identification(unknowns)))
    if name != "geometry" and rows.size < NUMBERS_EACH * count:
        untried = f"{rows.size} numbers are too few for {count} unknowns"
        return Step(name, untried=untried), before
    errors = _unseen_errors(task, rows)
    gain = before - errors
    standard_error = float(gain.std(ddof=1) / np.sqrt(gain.size))
    return Step(name, float(gain.mean()), standard_error, bool(gain.mean() > standard_error)), errors


def _unseen_errors(task: Task, rows: Mixture) -> Floats:
    """Each row's distance (N,), mm, from a model that was made without it."""
    order = np.random.default_rng(len(rows)).permutation(len(rows))
    errors = np.zeros(len(rows))
    for part in np.array_split(order, min(FOLDS, len(rows))):
        test = np.sort(part)
        others = rows.pick(np.setdiff1d(np.arange(len(rows)), test))
        _, weighed = identify_kept(task, others)
        errors[test] = held_out_errors(task, weighed.found, others, rows.pick(test))
    return errors


def _some(count: int) -> Any:
    """At most `JUDGING` of so many rows, the same ones each time."""
    return np.sort(np.random.default_rng(count).permutation(count)[:JUDGING])
