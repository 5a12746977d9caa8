"""Reliability of a model's own σ, by cross-validation: inside and outside the measured joints."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self, final

import numpy as np

from cellctl.calibration.distributions import binomial_cdf, chi2_isf
from cellctl.calibration.folds import end_folds, evenly, judging, random_folds
from cellctl.calibration.identification.identify import Identification, Scales, fixed_rows
from cellctl.calibration.model.residual_model import PostureBasis
from cellctl.calibration.problem.measured_region import OUTSIDE, MeasuredRegion
from cellctl.calibration.problem.task import Task
from cellctl.calibration.rows.row_blocks import RowBlocks
from cellctl.calibration.selection.cross_validation import Folded, Predicted, squared_distances
from cellctl.kinematics import Floats

OF_EACH_END = 60
"""Rows used of each end of a joint's range, at most."""

UNLIKELY = 0.1
"""A low count of rows in their 95 % regions is significant at this p-value or less (binomial test). Ten times the level
of the verdict (`judgement.UNLIKELY`): here it only widens the regions, there it takes away the trust in σ."""

ROWS_AT_LEAST = 20
"""Of fewer rows too few can be held out at the ends of the joint ranges: a quarter of them is five."""

WIDEST = 3.0
"""Largest factor on the noise that is tried, in steps of 0.02: beyond it the model is wrong, not its tails."""

FEW = 250
"""With at most so many rows each fold affects noise and prior scales: these are estimated without it."""

NUMBERS = 6.0
"""Independent numbers that the rows at all ends of the joint ranges are together: x, y, z of a lower and an upper end.
"""

UPPER_Z = 1.2816
"""Quantile of the standard normal distribution for an upper 90 % point."""

RANGE, STEPS = (0.01, 3.0), 60
"""σ outside that are tried, in nominal's RMS error among the rows. A real UR10's nominal is 2.4 times as far off where
its joints were not measured as among the rows that it was registered on. A step is a factor of 1.10; the upper point is
rounded down to one."""


@final
@dataclass(frozen=True, eq=False)
class Reliability:
    """tails: factor on the noise for 95 % of held-out rows of the fit to be in their 95 % regions; 1 where no factor is
    needed. region: what to add outside the measured joints.
    """

    tails: float
    region: MeasuredRegion

    @classmethod
    def of(cls, task: Task, found: Identification) -> Self:
        """From random folds, and from the ends of the joint ranges, of the rows of the fit.

        Error maps state their own scatter and tails, by their own folds; outside the measured joints they predict
        hardly anything: there σ is that of the model without them.
        """
        if found.without_maps is not None:
            plain = cls.of(task, found.without_maps).region
            models = found.identified.state.model.residual_models
            return cls(1.0, replace(plain, scatter_mm=0.0, residual_models=models))
        used = task.rows.pick(list(found.used))
        if task.region is not None:  # a prior model has its own σ outside
            return cls(1.0, task.region.with_angles(used.q))
        most = float(np.sqrt(np.mean(used.errors(found.nominal.state) ** 2) / _axes(used)))
        tails, outside = _tails_and_outside(task, found, used, most) if len(used) >= ROWS_AT_LEAST else (1.0, most)
        model = found.identified.state.model
        in_space = float(np.sqrt(3.0) * np.hypot(outside, _far_sigma(found)))
        region = MeasuredRegion.of(used.q, in_space, _scatter(found, used), model.residual_models)
        scale, freedom = _model_error(found, used)
        return cls(tails, replace(region, model_error_scale=scale, degrees_of_freedom=freedom))


def _tails_and_outside(task: Task, found: Identification, used: RowBlocks, most: float) -> tuple[float, float]:
    """Factor on the noise for 95 % regions; 1 σ on each axis outside, mm. most: nominal's RMS error on each axis."""
    rows = used.pick(judging(len(used)))
    unknowns, deviations = found.identified.unknowns, found.identified.deviations
    registering = task.registration_parameters(unknowns)
    folded = Folded.of(
        unknowns, deviations, rows, fixed_rows(task, found.prior_scale), random_folds(rows.q), registering
    )
    logs = {factor: float(np.log(value)) for factor, value in Scales(found.noise, {}).factors(rows).items()}
    everything = np.ones(int(unknowns.free.sum()), bool)
    inner = folded.predicted(everything, logs, again=len(rows) <= FEW)
    tails = _tails(inner, folded.noise(logs)[inner.rows])
    at_ends = end_folds(rows.q)
    if not at_ends:
        return tails, most
    ends = folded.with_folds(at_ends).predicted(everything, logs, OF_EACH_END)
    share = _left_by_the_others(rows.q, at_ends)
    sigma = folded.length_sigma_mm[ends.rows]
    per_mm = np.divide(1.0, sigma, out=np.zeros_like(sigma), where=sigma > 0.0)
    return tails, _outside(ends, share, per_mm, most)


def mostly_outside(measured: Floats, predicted: Floats) -> bool:
    """Whether most of the postures `predicted` (M, n), rad, are outside those `measured` (N, n)."""
    if not len(predicted) or len(measured) < ROWS_AT_LEAST:
        return False
    return float(np.median(PostureBasis.over(measured).remainder(predicted))) > OUTSIDE


def _axes(rows: RowBlocks) -> int:
    """Number of axes of a row's error: 3 of a point, 1 of a distance."""
    return max((int(block.of_length.sum()) for block in rows.blocks if len(block)), default=1)


def _scatter(found: Identification, used: RowBlocks) -> float:
    """Scatter of the rows beyond their stated σ, 1 σ, 3-D, mm. With several kinds, the least of them: in the others it
    is due to the instrument. A noise factor φ means the variance (φ² − 1) σ² more on each axis, three times that in
    3-D.
    """
    excess = []
    for block, _, own in used.parts():
        lengths = block.of_length
        if len(block) and lengths.any():
            grown = np.maximum(found.noise[own][lengths] ** 2 - 1.0, 0.0)
            excess.append(float(np.mean(grown * block.sigma[:, lengths] ** 2)))
    return float(np.sqrt(3.0 * min(excess, default=0.0)))


def _model_error(found: Identification, used: RowBlocks) -> tuple[float, float]:
    """`model_error_scale` and `degrees_of_freedom` of the region: those of the kind of row that shows the most.

    Rows left out count: the search for outliers takes rows that a model error moved for outliers.
    """
    shown = (found.noise > 1.0).any() or found.outliers or found.identified.state.model.residual_models
    kinds = [(block.model_error_scale, -block.model_error_freedom) for block in used.blocks if len(block)]
    scale, freedom = min(kinds) if shown and kinds else (1.0, -np.inf)
    return scale, -freedom


def _far_sigma(found: Identification) -> float:
    """1 σ on each axis, mm, of the model's own residual models where nothing was measured; 0 without any."""
    unknowns, models = found.identified.unknowns, found.identified.state.model.residual_models
    return math.hypot(*(each.far_sigma(unknowns.sigma[unknowns.among(frozenset({each.group}))]) for each in models))


def _tails(predicted: Predicted, noise: Floats) -> float:
    """Factor on the noise (N, k), 1 σ, for 95 % of the rows to be in their 95 % regions; 1 where hardly fewer are."""
    known = ~predicted.placed
    if not known.any():
        return 1.0
    residual, covariance, own = predicted.residual[known], predicted.covariance[known], noise[known] ** 2
    limits = chi2_isf(0.05, np.count_nonzero(own > 0.0, axis=1))
    added = own[:, :, None] * np.eye(own.shape[1])

    def inside(factor: float) -> int:
        return int(np.count_nonzero(squared_distances(residual, covariance + (factor**2 - 1.0) * added) <= limits))

    if binomial_cdf(inside(1.0), len(residual), 0.95) > UNLIKELY:
        return 1.0
    enough = (each for each in np.arange(1.0, WIDEST, 0.02) if inside(float(each)) >= 0.95 * len(residual))
    return float(next(enough, WIDEST))


def _left_by_the_others(q: Floats, folds: Sequence[Any]) -> Floats:
    """The share of variance (M,) that the other rows leave at the used rows of each fold."""
    others = [np.delete(np.arange(len(q)), test) for test in folds]
    pairs = zip(folds, others, strict=True)
    return np.concatenate([PostureBasis.over(q[rest]).remainder(q[evenly(test, OF_EACH_END)]) for test, rest in pairs])


def _outside(ends: Predicted, share: Floats, per_mm: Floats, most: float) -> float:
    """1 σ s on each axis, mm, outside: the upper 90 % point of its profile likelihood from the rows at the ends; `most`
    where they say nothing.

    The errors e of the rows at an end are those of one smooth function, e ~ N(0, C + s² share I) with C what the model
    predicts: sixty of them are not sixty observations of s. The ends of different joints have rows in common as well.
    All of them count as `NUMBERS`, so L(s) = NUMBERS · the rows' log density per measured number. The most probable s
    is near 0 whenever the model holds at the ends by luck; then predictions outside are far worse than stated. The
    upper point, the largest s with L(s) ≥ max L − z²/2, is never 0 (one-sided, as 2 (max L − L) ~ χ²(1)).
    """
    known = ~ends.placed & (share > 0.0)
    if not known.any():
        return most
    residual, covariance = ends.residual[known], ends.covariance[known]
    added = (share[known, None] * per_mm[known] ** 2)[:, :, None] * np.eye(residual.shape[1])
    grid, fits = most * np.geomspace(*RANGE, STEPS), []
    for tried in grid:
        whole = covariance + tried**2 * added
        fits.append(float(np.sum(squared_distances(residual, whole) + np.linalg.slogdet(whole)[1])))
    measured = int(np.count_nonzero(per_mm[known]))
    # a touch or a length measures one direction, which changes from row to row: these are observations of their own,
    # counted once for each joint at whose end they are (`end_folds`): three times on average
    of_points = measured > len(residual)
    likelihood = -0.5 * (NUMBERS / measured if of_points else 1.0) * np.array(fits)
    return float(grid[np.flatnonzero(likelihood >= likelihood.max() - 0.5 * UPPER_Z**2)[-1]])
