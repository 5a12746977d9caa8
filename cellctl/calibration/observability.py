"""What the measurements cannot see, in words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
import scipy.linalg

from cellctl.calibration.estimate import Estimate
from cellctl.calibration.words import in_words, of_the_arm
from cellctl.kinematics import Floats

SEEN = 0.1
"""A combination is seen if one tolerance of it changes all rows together by this many standard deviations or more."""

NAMED = 8
"""Phrases of one combination that are named; the others are counted."""

_ALONE = " alone"


@final
@dataclass(frozen=True, slots=True)
class Observability:
    """What the data see of the free parameters.

    rank: number of combinations seen; unseen: the others, in words, single parameters in one phrase; singular (F,): by
    how many standard deviations one tolerance of each combination changes the rows, largest first.
    """

    rank: int
    unseen: tuple[str, ...]
    singular: tuple[float, ...]


def observability(estimate: Estimate, triangle: Floats | None = None) -> Observability:
    """Rank and unseen combinations of a fit, from its data alone (no tolerance helps).

    triangle: in place of the fit's own, as `estimate.seen_at_start` has it: at the solution, an identified geometry's
    errors can make visible in name what no row can tell from noise.
    """
    triangle = estimate.triangle if triangle is None else triangle
    _, singular, right = np.linalg.svd(triangle)
    rank = int(np.sum(singular >= SEEN))
    names = [name for name, free in zip(estimate.unknowns.names, estimate.unknowns.free, strict=True) if free]
    effect = np.linalg.norm(triangle, axis=0)
    words = [_words(names, weights) for weights in _sparse_combinations(right[rank:], effect, names)]
    return Observability(rank, _merged(words), tuple(float(value) for value in singular))


def _sparse_combinations(unseen: Floats, effect: Floats, names: list[str]) -> list[Floats]:
    """The unseen subspace (U, F) in a basis of few parameters each, as shares of effect on the rows (F,).

    Pivoted QR picks U parameters that the subspace is about; each basis vector holds one of them, none of the others.
    A link's parameter is picked before those of tool, base and centres: `θ1 with base rotation`, not the reverse.
    """
    if not len(unseen):
        return []
    shares = unseen * np.maximum(effect, 1e-12 * max(float(effect.max()), 1e-300))
    preference = np.where([of_the_arm(name) for name in names], 100.0, 1.0)
    _, _, pivots = scipy.linalg.qr(shares * preference, pivoting=True, mode="economic")
    chosen = np.sort(pivots[: len(unseen)])
    basis = np.linalg.lstsq(shares[:, chosen].T, np.eye(len(chosen)), rcond=None)[0].T @ shares
    return [np.asarray(row) for row in basis]


def _words(names: list[str], weights: Floats) -> str:
    """The parameters with a tenth or more of the greatest weight, as a sentence fragment."""
    strong = np.flatnonzero(np.abs(weights) >= 0.1 * np.max(np.abs(weights)))
    parts = in_words([names[index] for index in strong])
    others = [*parts[1:NAMED], *([f"{len(parts) - NAMED} others"] if len(parts) > NAMED else [])]
    return parts[0] + (f" with {', '.join(others)}" if others else _ALONE)


def _merged(words: list[str]) -> tuple[str, ...]:
    """The fragments with those of single parameters as one, where there are several: `θ5; d5: each alone`."""
    alone = [fragment.removesuffix(_ALONE) for fragment in words if fragment.endswith(_ALONE)]
    if len(alone) < 2:
        return tuple(words)
    others = [fragment for fragment in words if not fragment.endswith(_ALONE)]
    return (*others, f"{'; '.join(dict.fromkeys(alone))}: each{_ALONE}")
