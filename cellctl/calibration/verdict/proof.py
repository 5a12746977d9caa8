"""Requirements of a proof on held-out rows: enough rows in the fit, and consistent rows."""

from __future__ import annotations

from typing import Any

import numpy as np

from cellctl.calibration.estimation.identify import OVERDETERMINED, Identification
from cellctl.calibration.estimation.task import Task
from cellctl.calibration.rows import Measured
from cellctl.calibration.rows.row_blocks import RowBlocks
from cellctl.calibration.verdict.split import Split

TOO_NOISY = 10.0
PER_SEEN = 5
"""Rows that scatter `TOO_NOISY` times more than stated may be noisy, or contradict each other: to decide that takes
`PER_SEEN` numbers for each parameter that they determine."""


def doubts(task: Task, split: Split, found: Identification) -> list[str]:
    """Why no held-out row could show that `found` is better than nominal, in words; empty if it could."""
    if not split.judged:
        return ["no row was held out"]
    few = [words for fit, test in split.judged for words in _too_few(task, fit, test)]
    scatter = _scatter(task, found) if task.partial else []  # any model is better than one with a removed tool
    return [*dict.fromkeys(few), *_apart(found), *scatter, *_not_converged(found)]


def sigma_doubts(task: Task, found: Identification) -> list[str]:
    """Why the σ of `found` cannot be trusted whatever held-out rows show, in words; empty if it can.

    A real robot has errors that no model here has, and a few touches scatter many times more than its repeatability:
    that is no objection to a gain that other touches clearly show.
    """
    return [*_apart(found), *_scatter(task, found), *_not_converged(found)]


def _apart(found: Identification) -> list[str]:
    words = f"the rows of the fit do not fit together: {found.apart} of {len(found.used)} contradict the others"
    return [words] if found.apart else []


def _not_converged(found: Identification) -> list[str]:
    return [] if found.identified.converged else [f"the fit did not converge: {found.identified.ended}"]


def _scatter(task: Task, found: Identification) -> list[str]:
    """Rows that scatter far beyond their stated σ, and are too few to tell noise from contradiction."""
    numbers, noise = task.rows.pick(list(found.used)).size, float(found.noise.max())
    if found.apart or noise < TOO_NOISY or numbers >= PER_SEEN * found.identified.seen_by_data:
        return []
    return [f"the rows of the fit do not fit together: they scatter {noise:.0f} times more than they say"]


def _too_few(task: Task, fit: Any, test: Any) -> list[str]:
    """With hardly more numbers than unknowns *nominal* has small errors on the rows of the fit, large ones on others,
    and any model is better.
    """
    rows, held_out = task.rows.pick(fit), task.rows.pick(test)
    needed = OVERDETERMINED * task.registering
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
        needed = OVERDETERMINED * (9 if "tool" in session.own else 6)
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
