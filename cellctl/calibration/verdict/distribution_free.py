"""A bound of the next row's error that assumes no distribution: CV+ on the rows of the fit.

Barber, Candès, Ramdas and Tibshirani (2021, Predictive inference with the jackknife+, Annals of Statistics 49, doi
10.1214/20-AOS1965). Row i is predicted by the model μ₋ᵢ without its fold, with error R_i. At a new row x

    bound(x) = the ⌈(1 − α)(n + 1)⌉-th smallest of R_i + |μ₋ᵢ(x) − μ(x)|

about the prediction μ(x) of all rows. By the triangle inequality this ball contains the CV+ region. A new row, drawn as
the n were, is inside with probability 1 − 2α − (1 − K/n)/(K + 1) at least (their theorem 4; K folds), whatever its
errors are distributed like; usually it is 1 − α.

**What it is about.** The *measured* row, its noise included: the three coordinates of a point; of touches the distance
along the normal alone. Rows are binned by predicted σ, so that uncertain places have their own bound (Mondrian: the n
are those of the bin). σ of a row of the fit is that without its fold, or new rows would seem less certain than all of
them. Folds leave the terms of the model, its scales and its linearisation as they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self, final

import numpy as np
from scipy.linalg import cho_solve

from cellctl.calibration.folds import judging, postures
from cellctl.calibration.identification.identify import Identification, Scales, certified_rows
from cellctl.calibration.prediction.predict import predict_rows
from cellctl.calibration.problem.measured_region import OUTSIDE, MeasuredRegion
from cellctl.calibration.problem.task import Task
from cellctl.calibration.rows import Measured
from cellctl.calibration.rows.row_blocks import RowBlocks
from cellctl.calibration.selection.cross_validation import Folded, factored
from cellctl.calibration.solver.estimate import Estimate, linearised
from cellctl.kinematics import Floats

ALPHA = 0.05

ROWS_AT_LEAST = 19
"""Of a bin: with fewer, ⌈(1 − α)(n + 1)⌉ is more than n, and there is no bound."""

BINS_AT_MOST = 5
"""More bins of 1000 rows would follow σ more closely than σ itself is known."""

FOLDS_AT_MOST = 50
"""Up to 50 postures are left out one by one (jackknife+: no loss of guarantee); with more the loss is below 0.02."""


@final
@dataclass(frozen=True, eq=False)
class Bin:
    """Rows of similar predicted σ: up to sigma_to, mm; errors R (n,), mm, and the fold (n,) of each."""

    sigma_to: float
    errors: Floats
    folds: Any


@final
@dataclass(frozen=True, eq=False)
class DistributionFreeBound:
    """The bound, or why there is none.

    bins: by rising σ, empty where it is `unknown`, in words. guarantee: probability that a new row is inside, at least.
    along_normal: it is about the distance along the normal alone. noise (k,): factor on the σ of a row's numbers.
    shifts (K, F): of the free unknowns without each fold, in prior σ. typical_mm: of each bin, the median over the rows
    of the fit; NaN where none of them, predicted by all, has so large a σ.
    """

    bins: tuple[Bin, ...]
    unknown: str
    guarantee: float
    along_normal: bool
    found: Estimate
    noise: Floats
    region: MeasuredRegion
    shifts: Floats
    typical_mm: tuple[float, ...] = ()

    @classmethod
    def of(cls, task: Task, found: Identification, region: MeasuredRegion) -> Self:
        """From the rows of the fit."""
        used = task.rows.pick(list(found.used))
        blocks = [block for block in used.blocks if len(block)]
        noise = next(found.noise[own] for block, _, own in used.parts() if len(block))
        along = any(block.along_line for block in blocks)
        none = cls((), "", 0.0, along, found.identified, noise, region, np.zeros((0, 0)))
        if reason := _unknown(task, found, blocks):
            return replace(none, unknown=reason)
        rows = used.pick(judging(len(used)))
        folds = _folds(rows.q)
        if not _others_have_the_points(rows, folds):
            return replace(none, unknown="a point or session is in the rows of one fold alone")
        errors, sigma, shifts = _left_out(task, found, rows, folds, none._extra(rows.q))
        fold = np.empty(len(rows), int)
        for number, test in enumerate(folds):
            fold[test] = number
        only = next(block for block in rows.blocks if len(block))
        count, kept = len(rows), 1.0 - 2.0 * ALPHA
        guarantee = kept - (1.0 - min(len(folds) / count, 1.0)) / (len(folds) + 1)
        bound = replace(none, bins=_binned(sigma, errors, fold), guarantee=guarantee, shifts=shifts)
        return replace(bound, typical_mm=bound._typical(only))

    def at(self, rows: Measured) -> Floats:
        """Bounds (N,), mm, of the errors of new rows of the fit's kind; NaN where it is not known: outside the measured
        region, or where σ is larger than that of all rows of the fit.
        """
        result = np.full(len(rows), np.nan)
        if not self.bins:
            return result
        near = self.region.coverage.remainder(rows.q) <= OUTSIDE
        shift, sigma = self._shift(rows), self._sigma(rows)
        which = np.searchsorted([each.sigma_to for each in self.bins], sigma)
        for number, each in enumerate(self.bins):
            mine = near & (which == number)
            rank = int(np.ceil((1.0 - ALPHA) * (len(each.errors) + 1)))
            result[mine] = np.sort(each.errors + shift[mine][:, each.folds], axis=1)[:, rank - 1]
        return result

    def summary(self) -> dict[str, Any]:
        """For JSON."""
        sizes = (None if np.isnan(mm) else mm for mm in self.typical_mm)
        pairs = zip(self.bins, sizes, strict=True)
        return {
            "of": "distance along the normal" if self.along_normal else "point",
            "alpha": ALPHA,
            "guarantee": self.guarantee if self.bins else None,
            "bins": [{"sigma_to": b.sigma_to, "rows": len(b.errors), "bound_mm": mm} for b, mm in pairs],
            "unknown": self.unknown,
        }

    def _typical(self, rows: Measured) -> tuple[float, ...]:
        bounds = self.at(rows)
        known = np.isfinite(bounds)
        which = np.searchsorted([each.sigma_to for each in self.bins], self._sigma(rows))
        medians = (bounds[known & (which == number)] for number in range(len(self.bins)))
        return tuple(float(np.median(each)) if each.size else float("nan") for each in medians)

    def _extra(self, q: Floats) -> Floats:
        """1 σ (N,) on each axis, mm, that the region adds at q (N, n), rad."""
        return np.asarray(self.region.sigma(q) / np.sqrt(3.0))

    def _sigma(self, rows: Measured) -> Floats:
        """Predicted σ (N,), mm, of the distances of new rows."""
        noisy, extra = rows.noisier(self.noise), self._extra(rows.q)
        predicted = predict_rows(self.found.state, self.found.covariance, noisy, extra_sigma=extra)
        return np.asarray(np.sqrt(predicted.variance))

    def _shift(self, rows: Measured) -> Floats:
        """How far (N, K), mm, the models without a fold are from that of all rows."""
        free = np.flatnonzero(self.found.unknowns.free)
        columns, _ = linearised(rows, self.found.state, free, self.found.unknowns.sigma[free])
        lengths = (columns * rows.sigma[..., None])[:, rows.of_length]
        return np.asarray(np.linalg.norm(lengths @ self.shifts.T, axis=1))


def _unknown(task: Task, found: Identification, blocks: Sequence[Measured]) -> str:
    """Why there is no bound, in words; empty if there is one."""
    if task.prior is not None:
        return "the prior model has other rows"
    if found.without_maps is not None:
        return "error maps are learnt from the rows of all folds"
    if len(blocks) != 1:
        return "rows of several kinds or sessions are not drawn alike"
    if len(blocks[0]) < ROWS_AT_LEAST:
        return f"{len(blocks[0])} rows, {ROWS_AT_LEAST} at least"
    return ""


def _folds(q: Floats) -> list[Any]:
    """Sets of indices that divide the rows at q (N, n), rad; repeats of a posture in one set."""
    number = postures(q)
    count = int(number.max()) + 1
    fold = np.empty(count, int)
    fold[np.random.default_rng(len(q)).permutation(count)] = np.arange(count) % min(count, FOLDS_AT_MOST)
    return [np.flatnonzero(fold[number] == place) for place in range(min(count, FOLDS_AT_MOST))]


def _others_have_the_points(rows: RowBlocks, folds: Sequence[Any]) -> bool:
    points = np.concatenate([block.visited for block in rows.blocks])
    return all(np.isin(points[test], np.delete(points, test)).all() for test in folds)


def _left_out(
    task: Task, found: Identification, rows: RowBlocks, folds: Sequence[Any], extra: Floats
) -> tuple[Floats, Floats, Floats]:
    """Error (N,) and σ (N,), mm, of each row by the model without its fold; and the shifts (K, F) of these models.

    extra (N,): 1 σ on each axis, mm, besides that of the model.
    """
    best = found.identified
    none = np.zeros(len(best.unknowns.names), bool)
    folded = Folded.of(best.unknowns, best.deviations, rows, certified_rows(task), folds, none)
    logs = {factor: float(np.log(value)) for factor, value in Scales(found.noise, {}).factors(rows).items()}
    system, linear, mm = folded.system, folded.linear, folded.length_sigma_mm
    noise, lengths = folded.noise(logs), mm > 0.0
    whole = -np.linalg.solve(*system.posterior(logs))
    errors, variance, shifts = np.empty(len(rows)), np.empty(len(rows)), []
    for test, own in folded.folds:
        others = {f: n.without(own[f]) if f in own else n for f, n in system.numbers.items()}
        JtJ, Jtr = replace(system, numbers=others).posterior(logs)
        columns = linear.jacobian[test]
        sides = np.column_stack([-Jtr, columns.reshape(-1, len(Jtr)).T])
        answers = cho_solve(factored(JtJ), sides, check_finite=False)
        x, spread = answers[:, 0], answers[:, 1:].T.reshape(columns.shape)
        errors[test] = np.linalg.norm((linear.residual[test] + columns @ x) * mm[test], axis=1)
        own_variance = np.einsum("nkf,nkf->nk", columns, spread) + noise[test] ** 2
        variance[test] = np.sum(own_variance * mm[test] ** 2 + lengths[test] * extra[test, None] ** 2, axis=1)
        shifts.append(x - whole)
    return errors, np.sqrt(variance), np.array(shifts)


def _binned(sigma: Floats, errors: Floats, fold: Any) -> tuple[Bin, ...]:
    """Bins of equally many rows by predicted σ (N,), mm."""
    order = np.argsort(sigma, kind="stable")
    count = min(max(len(order) // (2 * ROWS_AT_LEAST), 1), BINS_AT_MOST)
    return tuple(Bin(float(sigma[some].max()), errors[some], fold[some]) for some in np.array_split(order, count))
