"""Rows of the fit and held-out rows, and the requirements of a proof on them: enough rows, and consistent rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self, final

import numpy as np

from cellctl.calibration.identification.identify import OVERDETERMINED, Identification
from cellctl.calibration.problem.task import Task
from cellctl.calibration.rows import Measured
from cellctl.calibration.rows.row_blocks import RowBlocks
from cellctl.kinematics import Bools


@final
@dataclass(frozen=True, eq=False)
class Split:
    """Rows the model is made from, and pairs (fit, held out) by which it is judged: indices into a task's rows."""

    fit: Any
    judged: tuple[tuple[Any, Any], ...]

    @property
    def folds_apart(self) -> tuple[int, ...]:
        """The numbers of those pairs whose model is not the one made from `fit`."""
        return tuple(number for number, (one, _) in enumerate(self.judged) if one is not self.fit)

    @classmethod
    def by_column(cls, held_out: Bools) -> Self:
        """Rows where `held_out` (N,) is true are held out."""
        fit, test = np.flatnonzero(~held_out), np.flatnonzero(held_out)
        return cls(fit, ((fit, test),) if test.size else ())

    @classmethod
    def holdout(cls, rows: int, fraction: float, seed: int, groups: Sequence[int] | None = None) -> Self:
        """A random share of the rows is held out, those of a group together."""
        number = _numbered(rows, groups)
        order = np.random.default_rng(seed).permutation(number.max(initial=-1) + 1)
        sizes = np.bincount(number)[order]
        chosen = np.zeros(len(order), bool)
        chosen[order] = np.cumsum(sizes) - sizes < round(fraction * rows)
        return cls.by_column(chosen[number])

    @classmethod
    def folds(cls, rows: int, count: int, seed: int, groups: Sequence[int] | None = None) -> Self:
        """The model is made from all rows; each fold is judged by a model made from the others.

        groups (N,): a number for each row; rows of one group are held out together, so that repeats of a measurement do
        not judge a model made from them. Default: each row is its own group.
        """
        number = _numbered(rows, groups)
        order = np.random.default_rng(seed).permutation(number.max(initial=-1) + 1)
        fold = np.empty(len(order), int)
        for place, part in enumerate(np.array_split(order, count)):
            fold[part] = place
        parts = [fold[number] == place for place in range(min(count, len(order)))]
        return cls(np.arange(rows), tuple((np.flatnonzero(~part), np.flatnonzero(part)) for part in parts))

    @classmethod
    def leaving_out(cls, labels: Sequence[str]) -> Self:
        """Made from all rows; the rows of each label in turn are judged by a model made from the others."""
        names, everything = np.array(labels), np.arange(len(labels))
        parts = [np.flatnonzero(names == name) for name in sorted(set(labels))]
        return cls(everything, tuple((np.setdiff1d(everything, part), part) for part in parts if len(parts) > 1))


def _numbered(rows: int, groups: Sequence[int] | None) -> Any:
    """The group of each row (N,), numbered in order of appearance: without repeats the same as without groups."""
    if groups is None:
        return np.arange(rows)
    counted: dict[int, int] = {}
    return np.array([counted.setdefault(group, len(counted)) for group in groups], dtype=int)


TOO_NOISY = 10.0
PER_PARAMETER = 5
"""Rows that scatter `TOO_NOISY` times more than stated may be noisy, or contradict each other: to decide that takes
`PER_PARAMETER` numbers for each parameter that they determine."""


def doubts(task: Task, split: Split, found: Identification) -> list[str]:
    """Why no held-out row could show that `found` is better than nominal, in words; empty if it could."""
    if not split.judged:
        return ["no row was held out"]
    few = [words for fit, test in split.judged for words in _too_few(task, fit, test)]
    scatter = (
        _scatter(task, found) if task.is_partial_update else []
    )  # any model is better than one with a removed tool
    return [*dict.fromkeys(few), *_apart(found), *scatter, *_not_converged(found)]


def sigma_doubts(task: Task, found: Identification) -> list[str]:
    """Why the σ of `found` cannot be trusted whatever held-out rows show, in words; empty if it can.

    A real robot has errors that no model here has, and a few touches scatter many times more than its repeatability:
    that is no objection to a gain that other touches clearly show.
    """
    return [*_apart(found), *_scatter(task, found), *_not_converged(found)]


def _apart(found: Identification) -> list[str]:
    words = (
        f"the rows of the fit do not fit together: {found.n_inconsistent} of {len(found.used)} contradict the others"
    )
    return [words] if found.n_inconsistent else []


def _not_converged(found: Identification) -> list[str]:
    return [] if found.identified.converged else [f"the fit did not converge: {found.identified.ended}"]


def _scatter(task: Task, found: Identification) -> list[str]:
    """Rows that scatter far beyond their stated σ, and are too few to tell noise from contradiction."""
    numbers, noise = task.rows.pick(list(found.used)).size, float(found.noise.max())
    if found.n_inconsistent or noise < TOO_NOISY or numbers >= PER_PARAMETER * found.identified.effective_parameters:
        return []
    return [f"the rows of the fit do not fit together: they scatter {noise:.0f} times more than they say"]


def _too_few(task: Task, fit: Any, test: Any) -> list[str]:
    """With hardly more numbers than unknowns *nominal* has small errors on the rows of the fit, large ones on others,
    and any model is better.
    """
    rows, held_out = task.rows.pick(fit), task.rows.pick(test)
    needed = OVERDETERMINED * task.n_registration
    if rows.size < needed:
        each = -(-needed // int(rows.numbers.max(initial=1)))
        return [f"{len(rows)} rows in the fit are too few to judge it by others, {each} at least"]
    kinds = dict.fromkeys(type(block) for block in task.rows.blocks)
    rare = [words for kind in kinds if kind.visits_at_least for words in _rarely_visited(task, rows, held_out, kind)]
    return [*rare, *_rarely_shown(task, rows, held_out), *_short_sessions(task, rows, held_out)]


def _short_sessions(task: Task, rows: RowBlocks, held_out: RowBlocks) -> list[str]:
    """Held-out sessions with hardly more numbers than tie them to the robot."""
    known = {block.session for block in rows.blocks if len(block)}
    found = []
    for number, session in enumerate(task.sessions):
        sizes = [block.sigma.size for block in held_out.blocks if block.session == number and (block.visited < 0).all()]
        needed = OVERDETERMINED * (9 if "tool" in session.own else 6)  # a base has 6 numbers, the place of a tool 3
        if number not in known and 0 < sum(sizes) < needed and session.own:
            found.append(f"session {session.name} has {sum(sizes)} numbers to judge by, {needed} at least")
    return found


def _rarely_visited(task: Task, rows: RowBlocks, held_out: RowBlocks, kind: type[Measured]) -> list[str]:
    """Points with too few visits to know their place: in the fit, or, if not in it, among the held-out rows."""
    least = kind.visits_at_least
    of_fit, judging = _visits(task, rows, kind), _visits(task, held_out, kind)
    known, where = np.where(of_fit > 0, of_fit, judging), np.where(of_fit > 0, "in the fit", "to judge by")
    return [
        f"{kind.noun} {task.points[index]} has {known[index]} {kind.visits} {where[index]}, {least} at least"
        for index in np.flatnonzero((judging > 0) & (known < least))
    ]


def _rarely_shown(task: Task, rows: RowBlocks, held_out: RowBlocks) -> list[str]:
    """Instruments with too few lengths to know their zero: the lengths of each have to find it and its points, and to
    check that they agree.
    """
    (of_fit, found), (judging, finding) = _shown(task, rows), _shown(task, held_out)
    known, where = np.where(of_fit > 0, of_fit, judging), np.where(of_fit > 0, "in the fit", "to judge by")
    least = np.where(of_fit > 0, found, finding)
    return [
        f"zero {task.datums[index]} has {known[index]} lengths {where[index]}, {least[index]} at least"
        for index in np.flatnonzero((judging > 0) & (known < least))
    ]


def _shown(task: Task, rows: RowBlocks) -> tuple[Any, Any]:
    """Count of lengths of each instrument with unknown zero (D,), and the count required, with its points."""
    pairs = [np.column_stack([block.zeros, block.visited])[block.zeros >= 0] for block in rows.blocks]
    shown = np.concatenate([np.zeros((0, 2), int), *pairs]).astype(int)
    points = np.bincount(np.unique(shown, axis=0)[:, 0], minlength=len(task.datums))
    return np.bincount(shown[:, 0], minlength=len(task.datums)), 3 * points + 1 + 1  # one zero, one that can disagree


def _visits(task: Task, rows: RowBlocks, kind: type[Measured]) -> Any:
    """Count of rows of `kind` at each point (S,)."""
    points = [block.visited for block in rows.blocks if isinstance(block, kind)]
    visited = np.concatenate([np.zeros(0, int), *points]).astype(int)
    return np.bincount(visited, minlength=len(task.points))
