"""Which rows are outliers: inliers are separated from noisy rows, and outliers searched at a known noise.

**Leave-one-out χ².** Rows are linear about a fit: r_i + J_i x (k numbers, in σ), A = JᵀJ + C⁻¹ of the kept rows. The
prediction of row i from the *others* misses it by (I − H_ii)⁻¹ r_i with covariance (I − H_ii)⁻¹, H_ii = J_i A⁻¹ J_iᵀ
its leverage, so

    t_i = r_iᵀ (I − H_ii)⁻¹ r_i ~ χ²(k)    (a row left out: r_iᵀ (I + J_i A⁻¹ J_iᵀ)⁻¹ r_i)

without a new fit (Cook and Weisberg 1982, Residuals and Influence in Regression; for k = 1 the square of Baarda's w of
data snooping, 1968). Ordinary residuals hide an outlier: a model with as many parameters as a robot's follows it, its
neighbours get larger residuals than it has, and these raise the noise estimate.

**Which set.** A row is an outlier if t_i exceeds the limit of its p-value. Many sets of rows satisfy that: a single
clean row among outliers seems to be one, and outliers can agree with each other. The right set S has the least
penalised cost

    cost(S) = χ²(S at its own mode) + Σ_{i ∉ S} χ²_{k_i}(p),

each row left out counting as the χ² at which it just becomes an outlier. Leaving i out lowers χ² by exactly t_i, so
the best next row is known without trying. Where every row changes the model much (few rows, many unknowns), leaving
out the worst row repeatedly does not find S: `ABREAST` sets are followed in parallel (beam search).

**Outliers or noise.** Explanations are compared by the probability of all rows: a few outliers among rows with the
stated noise, or more noise in all rows or in all of one kind. With factors φ of noise,

    ln p = −Σ n ln φ − ½ ln|A(φ)| − ½ χ²(S) − Σ_{i ∉ S} (ln 1/`OUTLIER_SHARE` + k_i ln `WIDTH`):

an outlier may be anywhere within `WIDTH` standard deviations, and occurs with probability `OUTLIER_SHARE`. A(φ) is that
of all rows, also of those left out: it depends on φ alone, not on S.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Self, final

import numpy as np

from cellctl.calibration.distributions import chi2_isf
from cellctl.calibration.selection.cross_validation import Linear
from cellctl.kinematics import Bools, Floats

OUTLIER_P = 1e-5
"""A row of the fit is an outlier if its p-value, predicted from the others, is below this: fewer than one clean row in
a hundred thousand is lost, and most outliers of ten standard deviations are found. For each row: of 3000 clean rows one
is lost in 3 of 100 sets.
"""

OUTLIER_P_BESIDE = 1e-4
"""The same where an outlier has been found: more are then likely, and an outlier that stays does more harm than a
clean row that is left out.
"""

LEFT_OUT_AT_MOST = 0.45
"""No search beyond this share of outliers of any block: beyond one half, outliers and inliers cannot be separated."""

DECISIVE = 10
"""With more numbers than this for each unknown no row has enough influence to hide another: the mean leverage F/n is
below 0.1, and √t_i is 95 % (√(1 − 0.1)) of the row's own error."""

ABREAST = 20
"""Sets of rows that are followed in parallel, with one more row left out at each stage."""

PATIENCE = 3
"""Stages without a cheaper set before the search ends: outliers that hide each other get cheaper only together."""


@final
@dataclass(frozen=True, eq=False)
class Kept:
    """Rows (N,) that are inliers, the leave-one-out χ² of each row, the unknowns x (F,) by the inliers, the χ² of both,
    and that χ² with the penalty of the rows left out.
    """

    rows: Bools
    leave_one_out_chi2: Floats
    x: Floats
    misfit: float
    cost: float

    @classmethod
    def of(cls, linear: Linear, rows: Bools, limit: Floats) -> Self:
        """From the prediction of these `rows`."""
        leave_one_out_chi2, x = linear.leave_one_out_chi2(rows)
        misfit = linear.misfit(rows, x)
        return cls(rows, leave_one_out_chi2, x, misfit, misfit + float(limit[~rows].sum()))


def within_limit(linear: Linear, *, thorough: bool) -> Kept | None:
    """Rows whose leave-one-out χ² is within the limit; None where too few are left. thorough: the cheapest of many
    sets.
    """
    limit = chi2_isf(OUTLIER_P, linear.numbers)
    everyone = Kept.of(linear, np.ones(len(linear.residual), bool), limit)
    if not (everyone.leave_one_out_chi2 > limit).any():
        return everyone
    limit = chi2_isf(OUTLIER_P_BESIDE, linear.numbers)
    found = _settled(linear, everyone, limit)
    if not thorough or linear.numbers.sum() > DECISIVE * len(linear.known):
        return found
    other = _settled(linear, _cheapest(linear, everyone, limit), limit)
    return min((each for each in (found, other) if each is not None), key=lambda each: each.cost, default=None)


def _cheapest(linear: Linear, everyone: Kept, limit: Floats) -> Kept:
    """The cheapest set found from `everyone` by leaving out one row after another (beam search).

    The gain from leaving out one more row is known in advance: it is that row's leave-one-out χ².
    """
    best, abreast, waited = everyone, [everyone], 0
    while abreast and waited < PATIENCE:
        costs = np.array([np.where(each.rows, each.cost + limit - each.leave_one_out_chi2, np.inf) for each in abreast])
        further: dict[bytes, Bools] = {}
        for place in np.argsort(costs, axis=None):
            way, row = np.unravel_index(place, costs.shape)
            rows = _changed(abreast[way].rows, row, False)
            if len(further) == ABREAST or not np.isfinite(costs[way, row]):
                break
            further.setdefault(rows.tobytes(), rows)
        abreast = [Kept.of(linear, rows, limit) for rows in further.values() if not _too_many(linear, rows)]
        cheapest = min([best, *abreast], key=lambda each: each.cost)
        best, waited = cheapest, 0 if cheapest is not best else waited + 1
    return best


def _settled(linear: Linear, kept: Kept, limit: Floats) -> Kept | None:
    """`kept` without rows beyond the limit, the greatest leave-one-out χ² first, and with rows that are now within it;
    None where too many are out.
    """
    # A fiftieth of all rows, a tenth of the outlying ones or a quarter of those that come back at a time: of thousands,
    # one at a time would take as many inversions. The worst of many hardly hide each other; the second loop corrects
    # it.
    count = len(limit)
    while (outlying := kept.rows & (kept.leave_one_out_chi2 > limit)).any():
        worst = np.argsort(np.where(outlying, -kept.leave_one_out_chi2, np.inf))[
            : max(1, count // 50, np.count_nonzero(outlying) // 10)
        ]
        kept = Kept.of(linear, _changed(kept.rows, worst[outlying[worst]], False), limit)
        if _too_many(linear, kept.rows):
            return None
    for _ in range(count):  # a row left out because of an outlier is kept again, the least χ² first
        back = ~kept.rows & (kept.leave_one_out_chi2 <= limit)
        if not back.any():
            break
        nearest = np.argsort(np.where(back, kept.leave_one_out_chi2, np.inf))[: max(1, np.count_nonzero(back) // 4)]
        kept = Kept.of(linear, _changed(kept.rows, nearest, True), limit)
    return kept


def _changed(rows: Bools, which: Any, to: bool) -> Bools:
    result = rows.copy()
    result[which] = to
    return result


def _too_many(linear: Linear, rows: Bools) -> bool:
    """Whether more than `LEFT_OUT_AT_MOST` of the rows of any block are left out, and more than one."""
    of_block = linear.factors[:, 0]
    left_out, all_of = np.bincount(of_block[~rows], minlength=of_block.max() + 1), np.bincount(of_block)
    return bool((left_out > np.maximum(LEFT_OUT_AT_MOST * all_of, 1)).any())


OUTLYING = 1e-6
"""A held-out row is reported if its p-value, predicted from the identified model, is below this."""

WIDTH = 20.0
"""Range of an outlier, in standard deviations, where outliers are weighed against more noise of all rows. The factor
(2π)^(−k/2) of the normal density is left out of inliers: as a density for each number, this is 1/(20 √(2π)), a range of
50 standard deviations."""

OUTLIER_SHARE = 0.05
"""How often a row is expected to be an outlier, for the same: with more, noisy rows would often be left out."""

STEP = 1.25
NOISIEST = 1e4
"""Factors of noise are tried in such steps, up to this. Rounded to a step, σ is wrong by up to 12 %, and the limit of a
single number is at 3.9 … 4.9 σ in place of 4.4."""

ROUNDS = 5
"""How often at most the scatter of all kinds is found from the model that it makes."""


@final
@dataclass(frozen=True, eq=False)
class Inliers:
    """kept (N,): the rows that are inliers; noise (Q,): the factors of σ with which they are, one for each of
    `RowBlocks.quantities`. log_probability: logarithm of how probable that makes all rows. misfitting (Q,): which kinds
    of numbers are further from the model than that, or belong to rows left out; none: all rows are explained.
    """

    kept: Bools
    noise: Floats
    log_probability: float
    misfitting: Bools

    @classmethod
    def at(cls, linear: Linear, noise: Floats, *, thorough: bool = False) -> Self:
        """The rows that are inliers with this noise."""
        scaled = linear.noisier(noise)
        kept = within_limit(scaled, thorough=thorough)
        if kept is None:
            return cls(np.ones(len(linear.residual), bool), noise, -np.inf, _present(linear, noise))
        penalty = np.sum(np.log(1.0 / OUTLIER_SHARE) + linear.numbers[~kept.rows] * np.log(WIDTH))
        log_probability = _log_probability_bound(linear, noise) - 0.5 * kept.misfit - float(penalty)
        return cls(kept.rows, noise, log_probability, _misfitting(scaled, kept.rows, kept.x, noise))


def find_inliers(linear: Linear, *, thorough: bool = True) -> Inliers:
    """The rows that are inliers, by the most probable explanation: some outliers, some kinds noisy, or both.

    Starting from the stated noise, or from the scatter of each kind, the factors of all kinds of numbers, or of one of
    them, grow while that makes the rows more probable. thorough: no outlier hides another (`within_limit`).
    """
    found = Inliers.at(linear, np.ones(int(linear.factors.max()) + 1), thorough=thorough)
    if _present(linear, found.noise).sum() > 1 and found.misfitting.any():
        found = _as_scattered(linear, found, thorough=thorough)
    while True:
        noisier = max(_noisier(linear, found), key=lambda each: each.log_probability, default=found)
        if noisier.log_probability <= found.log_probability:
            return found
        found = max(
            noisier, Inliers.at(linear, noisier.noise, thorough=thorough), key=lambda each: each.log_probability
        )
        if _present(linear, found.noise).sum() == 1:  # all kinds of noise have been tried
            return found


def _as_scattered(linear: Linear, found: Inliers, *, thorough: bool) -> Inliers:
    """`found`, or the explanation by the scatter of every misfitting kind, where that is more probable: with many
    kinds, to get there step by step and kind by kind takes hundreds of evaluations of all rows.

    The factor of a kind is lowered, one step or to 1, where that makes the rows even more probable.
    """
    best = max(found, Inliers.at(linear, _scattering(linear, found)), key=lambda each: each.log_probability)
    if best is found:
        return found
    for kind in np.flatnonzero(best.noise > found.noise):
        for less in (best.noise[kind] / STEP, found.noise[kind]):
            tried = Inliers.at(linear, np.where(np.arange(len(best.noise)) == kind, less, best.noise))
            best = max(best, tried, key=lambda each: each.log_probability)
    return max(best, Inliers.at(linear, best.noise, thorough=thorough), key=lambda each: each.log_probability)


def _scattering(linear: Linear, found: Inliers) -> Floats:
    """Noise (Q,) equal to the scatter of the misfitting kinds about a model with this noise."""
    noise = found.noise
    for _ in range(ROUNDS):
        scatter = noise * linear.noisier(noise).scatter(found.kept)
        before, noise = noise, np.where(found.misfitting, _stepped(scatter), found.noise)
        if np.array_equal(noise, before):
            break
    return noise


def _stepped(noise: Floats) -> Floats:
    """The nearest powers of `STEP` between 1 and `NOISIEST`."""
    return np.asarray(STEP ** np.round(np.log(np.clip(noise, 1.0, NOISIEST / STEP)) / np.log(STEP)))


def _noisier(linear: Linear, found: Inliers) -> Iterator[Inliers]:
    """Explanations by more noise of all numbers together, and of one kind that is misfitting."""
    there = _present(linear, found.noise)
    if not found.misfitting.any():
        return
    alone = [np.arange(len(there)) == each for each in np.flatnonzero(found.misfitting)] if there.sum() > 1 else []
    for growing in [there, *alone]:
        best = found.log_probability
        noise = np.where(growing, STEP, 1.0) * found.noise
        while noise.max() < NOISIEST and _log_probability_bound(linear, noise) > best:
            tried = Inliers.at(linear, noise)
            yield tried
            if not (tried.misfitting & growing).any():
                break
            best, noise = max(best, tried.log_probability), np.where(growing, STEP, 1.0) * noise


def _log_probability_bound(linear: Linear, noise: Floats) -> float:
    """ln p of all rows with this noise if all residuals were 0 and none left out: no explanation exceeds it."""
    logs = np.append(np.log(noise), 0.0)[linear.factors]
    return float(-logs.sum() - linear.half_log_det(noise))


def _present(linear: Linear, noise: Floats) -> Bools:
    """Which kinds of numbers (Q,) are present."""
    return np.isin(np.arange(len(noise)), linear.factors)


def _misfitting(scaled: Linear, kept: Bools, x: Floats, noise: Floats) -> Bools:
    """Which kinds of numbers (Q,) have rows left out, or larger residuals from the model x than their σ predict."""
    squares = (scaled.residual + scaled.jacobian @ x) ** 2
    result = np.isin(np.arange(len(noise)), scaled.factors[~kept])
    for each in np.flatnonzero(_present(scaled, noise)):
        mine = scaled.factors == each
        result[each] |= squares[mine & kept[:, None]].sum() > np.count_nonzero(mine)
    return result
