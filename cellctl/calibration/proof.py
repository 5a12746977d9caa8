"""What a proof on held-out rows takes, whatever they show: enough rows in the fit, and rows that go together."""

from __future__ import annotations

from typing import Any

import numpy as np

from cellctl.calibration.identify import OVERDETERMINED, Identification, Task
from cellctl.calibration.rows import TouchRows
from cellctl.calibration.split import Split

PER_SPHERE = 4
"""Touches that find a centre and show that they agree."""

TOO_NOISY = 10.0
PER_SEEN = 5
"""Rows that scatter `TOO_NOISY` times more than they say may be noisy, or contradict each other: it takes `PER_SEEN`
numbers for each parameter that they determine to tell that."""


def doubts(task: Task, split: Split, found: Identification) -> list[str]:
    """Why no held-out row could show that `found` is better than nominal, in words; empty where nothing stands against
    it.
    """
    if not split.judged:
        return ["no row was held out"]
    few = [words for fit, test in split.judged for words in _too_few(task, fit, test)]
    apart = [f"the rows of the fit do not fit together: {found.apart} of {len(found.used)} contradict the others"]
    return [*dict.fromkeys(few), *(apart if found.apart else [])]


def misgivings(task: Task, found: Identification) -> list[str]:
    """What stands against `found` unless the held-out rows gain so much that it cannot matter, in words.

    A real robot has errors that no model here has, and its few touches scatter many times more than its repeatability:
    that alone must not refuse a gain which other touches show plainly.
    """
    numbers, noise = len(found.used) * len(task.rows.quantities), float(found.noise.max())
    if found.apart or noise < TOO_NOISY or numbers >= PER_SEEN * found.identified.seen_by_data:
        return []
    return [f"the rows of the fit do not fit together: they scatter {noise:.0f} times more than they say"]


def _too_few(task: Task, fit: Any, test: Any) -> list[str]:
    """With hardly more numbers than unknowns *nominal* looks good on the rows of the fit, bad on all others, and
    anything is better than that.
    """
    rows, held_out = task.rows.pick(fit), task.rows.pick(test)
    numbers, needed = len(rows) * len(rows.quantities), OVERDETERMINED * task.registering
    if numbers < needed:
        each = -(-needed // len(rows.quantities))
        return [f"{len(rows)} rows in the fit are too few to judge it by others, {each} at least"]
    if not (isinstance(rows, TouchRows) and isinstance(held_out, TouchRows)):
        return []
    counts = np.bincount(rows.sphere, minlength=len(task.spheres))
    judging = sorted(set(np.asarray(held_out.sphere).tolist()))
    return [
        f"sphere {task.spheres[index]} has {counts[index]} touches in the fit, {PER_SPHERE} at least"
        for index in judging
        if counts[index] < PER_SPHERE
    ]
