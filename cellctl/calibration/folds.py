"""Held-out rows of a cross-validation: random ones, or the ends of the measured joint ranges."""

from __future__ import annotations

from typing import Any

import numpy as np

from cellctl.kinematics import Floats

JUDGING = 1000
"""Rows that are cross-validated, at most: more take longer and do not change the result."""

FOLDS = 5
"""Each model is then made from 80 % of the rows: its held-out errors are slightly too large, on the safe side (decision
7)."""

SAME_RAD = 1e-3
"""Rows with joints this close are repeats: they are held out together, so that none predicts another.

Joints are rounded to this grid. Two readings δ apart are on either side of a grid limit with probability δ/`SAME_RAD`
for each joint, and then count as different postures. Exact repeats, as `Split.folds` groups them, never do."""

END = 0.25
"""The share of the rows at either end of a joint's range that is left out at a time: enough rows for a mean, and far
enough out that the others do not surround them."""

FIFTH = 0.2
"""The same for a residual model. A share of the rows, not of the angles: the outer fifth of the angles may have one row
or half of all rows (a wrist that was only at 0° and 180°), and neither shows how a function ends."""

END_AT_MOST = 0.45
"""With more than this share of the rows at one end (a joint that hardly moved), too few are left to predict them."""

MOVED_RAD = 0.2
"""A joint that moved less, 11°, has no ends: errors that depend on a joint change over some tens of degrees."""


def judging(count: int) -> Any:
    """Indices of at most `JUDGING` of `count` rows, the same each time."""
    return np.sort(np.random.default_rng(count).permutation(count)[:JUDGING])


def evenly(test: Any, most: int | None) -> Any:
    """At most `most` rows of a fold, evenly spaced; all where it is None."""
    return test if most is None else test[np.linspace(0, len(test) - 1, min(most, len(test))).astype(int)]


def postures(q: Floats) -> Any:
    """The number of the posture of each row (N,) at q (N, n), rad: repeats have the same."""
    return np.unique(np.round(q / SAME_RAD), axis=0, return_inverse=True)[1].ravel()


def random_folds(q: Floats) -> list[Any]:
    """At most `FOLDS` sets of indices that divide the rows at q (N, n), rad; repeats of a posture in one set.

    The draw depends on the rows alone: two models of them are compared on the same folds, so that their errors pair.
    """
    posture = postures(q)
    count = int(posture.max(initial=-1)) + 1
    order = np.random.default_rng(len(q)).permutation(count)
    fold = np.zeros(count, int)
    for place, part in enumerate(np.array_split(order, min(FOLDS, count))):
        fold[part] = place
    return [np.flatnonzero(fold[posture] == place) for place in range(min(FOLDS, count))]


def end_folds(q: Floats, share: float = END) -> list[Any]:
    """Sets of indices, two for each joint that moved: the `share` of the rows at the lower end of its range, and at the
    upper end.

    The sets overlap: of a robot with six joints each row is in 12 · `END` = 3 of them on average. Numbers of several
    ends together are not independent.
    """
    found = []
    for angle in q.T:
        if np.ptp(angle) < MOVED_RAD:
            continue
        lower, upper = np.quantile(angle, [share, 1.0 - share])
        ends = (np.flatnonzero(angle <= lower), np.flatnonzero(angle >= upper))
        found += [end for end in ends if 0 < len(end) <= END_AT_MOST * len(angle)]
    return found
