"""Which rows are outliers at a given noise: each row left out adds a penalty; the set with the least χ² is searched.

A row is an outlier if the *others* make its place improbable. Many sets of rows satisfy that: a single clean row among
outliers seems to be one, and outliers can agree with each other. The right set is the one whose kept rows have the
least χ², where each row left out counts as the χ² at which it just becomes an outlier. Where every row changes the
model much (few rows, many unknowns), leaving out the worst row repeatedly does not find that set: many sets are
followed in parallel.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self, final

import numpy as np
from scipy.stats import chi2

from cellctl.calibration.estimation.linear import Linear
from cellctl.kinematics import Bools, Floats

OUTLIER_P = 1e-5
"""A row of the fit is an outlier if its p-value, predicted from the others, is below this: fewer than one clean row in
a hundred thousand is lost, and most outliers of ten standard deviations are found.
"""

OUTLIER_P_BESIDE = 1e-4
"""The same where an outlier has been found: more are then likely, and an outlier that stays does more harm than a
clean row that is left out.
"""

LEFT_OUT_AT_MOST = 0.45
"""No search beyond this share of outliers of any block: beyond one half, outliers and inliers cannot be separated."""

DECISIVE = 10
"""With more numbers than this for each unknown no row has enough influence to hide another."""

ABREAST = 20
"""Sets of rows that are followed in parallel, with one more row left out at each stage."""

PATIENCE = 3
"""Stages without a cheaper set before the search ends."""


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
    limit = np.asarray(chi2.isf(OUTLIER_P, linear.numbers))
    everyone = Kept.of(linear, np.ones(len(linear.away), bool), limit)
    if not (everyone.leave_one_out_chi2 > limit).any():
        return everyone
    limit = np.asarray(chi2.isf(OUTLIER_P_BESIDE, linear.numbers))
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
