"""Which rows belong together: wild ones are told from noisy ones before anything is made from either.

Ordinary residuals hide a wild row: a model with as many parameters as a robot bends towards it, its neighbours look
worse than it does, and the noise that all seem to have excuses it. So each row is judged by what the *others* foresee,
and two explanations are weighed against each other: a few wild rows among rows as good as promised, or rows that all
are noisier than promised.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self, final

import numpy as np
from scipy.stats import chi2

from cellctl.calibration.estimate import linearised, prior_inverse
from cellctl.calibration.mixture import Mixture
from cellctl.calibration.rows import Rows
from cellctl.calibration.unknowns import Unknowns
from cellctl.kinematics import Bools, Floats

OUTLYING = 1e-6
"""A held-out row is named if what was identified would put it where it is less often than this."""

WILD = 1e-5
"""A row of the fit is wild if the others would put it where it is less often than this: hardly a clean row in a hundred
thousand is lost by it, and most wild rows of ten standard deviations are found.
"""

WILD_AT_MOST = 0.45
"""No search beyond this share of wild rows: with half of them wild nobody could say which half it is."""

WIDTH = 20.0
"""A wild row lies anywhere within so many standard deviations, for weighing it against noise that all rows have."""

WILD_SHARE = 0.2
"""How often a row is expected to be wild, for the same."""

NOISES = 1.25 ** np.arange(0, 45)
"""Factors of noise that are tried: 1 … 18 000 times what the rows say of themselves."""


@final
@dataclass(frozen=True, eq=False)
class Belonging:
    """kept (N,): the rows that belong together; noise: the factor of σ with which they do."""

    kept: Bools
    noise: float


@final
@dataclass(frozen=True, eq=False)
class Linear:
    """Rows about a state: `away + columns @ x` in standard deviations, x the unknowns in tolerances, expected at 0.

    away (N, k), columns (N, k, F): a row of fewer than k numbers is filled up with zeros; numbers (N,): how many it
    has. known (F, F), pull (F,): what holds x besides these rows: the tolerances and rows that are never in doubt, as
    normal equations; prior (F, F): the tolerances' part of it.
    """

    away: Floats
    columns: Floats
    numbers: Any
    known: Floats
    pull: Floats
    prior: Floats

    @classmethod
    def about(cls, unknowns: Unknowns, deviations: Floats, rows: Mixture, certain: Sequence[Rows]) -> Self:
        """`rows` linearised at `deviations` (P,) from the unknowns' start; `certain` rows are never wild."""
        free = np.flatnonzero(unknowns.free)
        scale = unknowns.sigma[free]
        x = deviations[free] / scale
        state = unknowns.state(deviations)

        def of(block: Rows) -> tuple[Floats, Floats]:
            columns, away = linearised(block, state, free, scale)
            return away - columns @ x, columns

        width = max(len(block.quantities) for block in rows.blocks)
        away, columns = np.zeros((len(rows), width)), np.zeros((len(rows), width, free.size))
        for block, mine, _ in rows.parts():
            away[mine, : len(block.quantities)], columns[mine, : len(block.quantities)] = of(block)
        prior = prior_inverse(unknowns, free)
        known, pull = prior, np.zeros(free.size)
        for own, lines in map(of, certain):
            known = known + np.einsum("nkp,nkq->pq", lines, lines)
            pull = pull + np.einsum("nkp,nk->p", lines, own)
        return cls(away, columns, rows.numbers, known, pull, prior)

    def noisier(self, factor: float) -> Self:
        """The same rows with their standard deviations times `factor`."""
        return replace(self, away=self.away / factor, columns=self.columns / factor)

    def normal(self, kept: Bools) -> tuple[Floats, Floats]:
        """Most probable unknowns x (F,) by the kept rows, and their covariance (F, F)."""
        columns, away = self.columns[kept], self.away[kept]
        flat = columns.reshape(columns.shape[0] * columns.shape[1], columns.shape[2])
        covariance = np.asarray(np.linalg.inv(self.known + flat.T @ flat), float)
        return np.asarray(-covariance @ (self.pull + flat.T @ away.reshape(-1))), covariance

    def surprise(self, kept: Bools) -> tuple[Floats, Floats]:
        """Squared distance (N,) of each row from where the *other* kept rows foresee it, in foreseen standard
        deviations (χ² with k degrees of freedom); and the most probable unknowns by the kept rows (F,).
        """
        x, covariance = self.normal(kept)
        residual = self.away + self.columns @ x
        spread = np.matmul(np.matmul(self.columns, covariance), np.swapaxes(self.columns, -1, -2))
        side = np.where(kept, -1.0, 1.0)[:, None, None]  # a kept row's own pull on x is taken out again
        foreseen = np.eye(spread.shape[-1]) + side * spread + 1e-9 * np.eye(spread.shape[-1])
        return np.einsum("nk,nk->n", residual, np.linalg.solve(foreseen, residual[..., None])[..., 0]), x

    @property
    def size(self) -> int:
        """How many numbers the rows hold."""
        return int(self.numbers.sum())

    def seen(self) -> float:
        """Natural logarithm of how much smaller all rows together make the volume of what x may be."""
        flat = self.columns.reshape(-1, self.columns.shape[-1])
        return float(0.5 * np.linalg.slogdet(self.known + flat.T @ flat)[1])


def belonging(linear: Linear) -> Belonging:
    """The rows that belong together, by the more probable explanation: some wild, or all noisy, or both.

    For each factor of noise the rows are left out one after another until none surprises the others; the factor is
    then weighed by what it makes of the kept rows and by how many it left out.
    """
    found, best = Belonging(np.ones(len(linear.away), bool), 1.0), -np.inf
    for noise in NOISES:
        scaled = linear.noisier(noise)
        kept, surprises = _unsurprised(scaled)
        if kept is None:
            continue
        weight = _weight(scaled, kept, surprises, noise)
        if weight > best:
            found, best = Belonging(kept, float(noise)), weight
        if kept.all() and surprises <= linear.size:
            break
    return found


def _unsurprised(linear: Linear) -> tuple[Bools | None, float]:
    """Rows none of which surprises the others, and their χ² with that of the unknowns; None where too few are left."""
    count = len(linear.away)
    limit, most = chi2.isf(WILD, linear.numbers), int(WILD_AT_MOST * count)
    kept = np.ones(count, bool)
    surprise, x = linear.surprise(kept)
    while (wild := kept & (surprise > limit)).any():
        worst = np.argsort(np.where(wild, -surprise, np.inf))[: max(1, count // 50, np.count_nonzero(wild) // 10)]
        kept[worst[wild[worst]]] = False
        surprise, x = linear.surprise(kept)
        if np.count_nonzero(~kept) > most:
            return None, np.inf
    for _ in range(count):  # a row left out for the sake of a wild one comes back, the least surprising first
        back = ~kept & (surprise <= limit)
        if not back.any():
            break
        nearest = np.argsort(np.where(back, surprise, np.inf))[: max(1, np.count_nonzero(back) // 4)]
        kept[nearest] = True
        surprise, x = linear.surprise(kept)
    return kept, _misfit(linear, kept, x)


def _misfit(linear: Linear, kept: Bools, x: Floats) -> float:
    """χ² of the kept rows about the model and of the unknowns about their tolerances."""
    residual = linear.away[kept] + linear.columns[kept] @ x
    return float(np.sum(residual**2) + x @ linear.prior @ x)


def _weight(linear: Linear, kept: Bools, misfit: float, noise: float) -> float:
    """Logarithm of how probable all rows are, with this factor of noise and these left out."""
    price = np.sum(np.log(1.0 / WILD_SHARE) + linear.numbers[~kept] * np.log(WIDTH))
    return float(-linear.size * np.log(noise) - linear.seen() - 0.5 * misfit - price)
