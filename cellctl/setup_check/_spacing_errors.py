"""Certified distances that contradict the rows, or each other.

A certificate is also a measurement, and may be an outlier: a wrong pair of spheres, a typing error, inches. So the
robot is identified from rows alone, without any certificate. Distances that contradict the rows are wrong, singly or
all by one factor. Then each distance is predicted from the rows and the remaining distances. If leaving out any one of
several makes the rest agree, all of these are reported. If one robot fits rows and certificate, none is reported.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np

from cellctl.calibration.identification.identify import Identification, Scales, identify, identify_kept
from cellctl.calibration.identification.ladder import climb
from cellctl.calibration.problem.task import Task
from cellctl.calibration.rows import SpacingRows
from cellctl.calibration.rows.row_blocks import RowBlocks
from cellctl.calibration.solver.estimate import Estimate
from cellctl.kinematics import Bools, Floats
from cellctl.setup_check._predicted_spacings import (
    FAR,
    LEAST_MM,
    PredictedSpacings,
    model_errors,
    with_best_centres,
    wrong,
)

SAMPLE = 300
"""Rows of instruments that predict the distances, and as many touches and visits, evenly from all points."""

SAMPLE_OF_EACH = 20
"""The sample always has so many of each instrument's rows, and of each point's."""

TOUCHES_AT_LEAST = 5
"""With fewer touches on a sphere, several centres may fit equally: its distances are not judged."""

REDUNDANCY, WIDER = 2.0, 4.0
"""Rows with less redundancy (their numbers less the effective parameters) cannot show that the prior is too narrow: the
fit takes each from itself. Then the σ of the estimates counts `WIDER` times: 30 touches of a robot scaled its prior by
4.3, and 25 of them, redundancy 0.1, put a right spacing of 700.4 mm at 704.6 ± 0.6 mm."""

FITTING = 3.0
"""Standard deviations of χ² within which a certificate agrees with a robot that also fits the rows."""

FEW = 3
"""With fewer different distances than this no common factor is estimated: each is reported."""

BETTER = 4.0
"""A common factor has to bring the distances nearer to their estimates by this ratio."""


@final
@dataclass(frozen=True, slots=True)
class SpacingError:
    """A certified distance, mm, that contradicts the estimate from the rows and the other distances, mm ± 1 σ.

    sigma: the fit's σ, with the error that its model lacks. certain: whether this one is wrong; else one of those
    reported is. least: the smallest error, mm, that would have been found.
    """

    between: tuple[str, str]
    given: float
    estimate: float
    sigma: float
    certain: bool
    least: float

    @property
    def what(self) -> str:
        """`spacing S1–S2: 503 mm given, 403.1 ± 0.1 mm estimated from these rows (errors from 0.7 mm are found)`."""
        digits = max(0, min(3, 1 - int(np.floor(np.log10(self.sigma)))))
        source = "these rows" if self.certain else "these rows and the other spacings"
        given = f"spacing {self.between[0]}–{self.between[1]}: {self.given:g} mm given"
        estimated = f"{self.estimate:.{digits}f} ± {self.sigma:.{digits}f} mm estimated from {source}"
        return f"{given}, {estimated} (errors from {self.least:.2g} mm are found)"


@final
@dataclass(frozen=True, slots=True)
class ScaleError:
    """All certified distances that the rows can judge, `count` of them, are wrong by one factor ± 1 σ.

    between, given: the first of them, mm. before, after: RMS, mm, of the differences from the estimates, as given and
    times `factor`.
    """

    between: tuple[str, str]
    given: float
    count: int
    factor: float
    sigma: float
    before: float
    after: float

    @property
    def what(self) -> str:
        """`all 120 spacings that can be checked: × 25.40 reduces their RMS error from 587 to 0.19 mm`."""
        factor = f"{self.factor:.{max(0, min(6, -int(np.floor(np.log10(self.sigma)))))}f}"
        error = f"from {self.before:.3g} to {self.after:.2g} mm"
        return f"all {self.count} spacings that can be checked: × {factor} reduces their RMS error {error}"


def find_spacing_errors(task: Task) -> tuple[SpacingError | ScaleError, ...]:
    """The certified distances of `task` that contradict the rows or other distances."""
    if task.spacings is None or not len(task.spacings) or task.rows.size < 2 * task.n_registration:
        return ()
    try:
        found = _contradicted(task, task.spacings)
        if not found or not task.candidates:
            return found
        climbed = climb(replace(task, spacings=None), task.rows.pick(_sample(task.rows)))  # a term may be missing
        return _contradicted(climbed.task, task.spacings)
    except np.linalg.LinAlgError:
        return ()


def _contradicted(task: Task, spacings: SpacingRows) -> tuple[SpacingError | ScaleError, ...]:
    groups = task.groups if task.prior is not None else None
    rows = task.rows.pick(_sample(task.rows))
    alone = replace(task, rows=rows, spacings=None, candidates=None, groups=groups)
    found = identify(alone)
    used = rows.pick(np.array(found.used))
    judged = _between(spacings, _known(used, len(task.points)))
    if not found.identified.converged or not len(judged):
        return ()
    predicted = _predicted(judged, found.identified, used, found.noise)
    if not wrong(predicted)[0].any() or _fits(alone, judged, found):
        return ()
    best, unsure = with_best_centres(found.identified, used.noisier(found.noise))
    judged = _between(judged, ~unsure)
    return _errors_of(task, judged, _predicted(judged, best, used, found.noise)) if len(judged) else ()


def _between(spacings: SpacingRows, points: Bools) -> SpacingRows:
    """Those between two of the `points` (S,)."""
    return spacings.pick(points[spacings.pairs].all(axis=1))


def _predicted(spacings: SpacingRows, found: Estimate, rows: RowBlocks, noise: Floats) -> PredictedSpacings:
    predicted = PredictedSpacings.of(spacings, found, model_errors(spacings, found, rows, noise))
    if rows.size - found.effective_parameters >= REDUNDANCY:
        return predicted
    return replace(predicted, covariance=WIDER**2 * predicted.covariance)


def _errors_of(
    task: Task, spacings: SpacingRows, predicted: PredictedSpacings
) -> tuple[SpacingError | ScaleError, ...]:
    """The common factor of all, or each contradicting distance; none where none contradicts."""
    if not wrong(predicted)[0].any():
        return ()
    names = [(task.points[first], task.points[second]) for first, second in spacings.pairs]
    scale = _scale(predicted, names[0])
    return (scale,) if scale is not None else _named(predicted, names)


def _sample(rows: RowBlocks) -> Any:
    """Which rows (N,) predict the distances: a sample from instruments, and as many from points."""
    owner = np.concatenate(
        [np.where(block.visited >= 0, block.visited, -1 - number) for number, block in enumerate(rows.blocks)]
    )
    chosen, rng = np.zeros(len(rows), bool), np.random.default_rng(0)
    for owners in (np.unique(owner[owner < 0]), np.unique(owner[owner >= 0])):
        for one in owners:
            mine = rng.permutation(np.flatnonzero(owner == one))
            chosen[mine[: max(SAMPLE // len(owners), SAMPLE_OF_EACH)]] = True
    return chosen


def _known(rows: RowBlocks, points: int) -> Bools:
    """Which points (S,) have enough rows for a unique place."""
    counted = np.zeros(points, int)
    for block in rows.blocks:
        if not block.of_planes:
            each = TOUCHES_AT_LEAST if block.at_point else 1
            counted += each * np.bincount(block.visited[block.visited >= 0], minlength=points)
    return counted >= TOUCHES_AT_LEAST


def _fits(alone: Task, spacings: SpacingRows, found: Identification) -> bool:
    """Whether a robot no further from nominal, with rows no noisier, fits the certificate too."""
    scales = Scales(found.noise, found.prior_scale)
    _, scaled = identify_kept(replace(alone, spacings=spacings), alone.rows.pick(np.array(found.used)), scales)
    more, count = scaled.found.cost - found.identified.cost, len(spacings)
    return scaled.found.converged and bool(more < count + FITTING * np.sqrt(2.0 * count))


def _scale(predicted: PredictedSpacings, first: tuple[str, str]) -> ScaleError | None:
    """The one factor that brings all distances to their estimates, if any distance contradicts and there is such a
    factor.
    """
    if np.unique(predicted.given).size < FEW or not predicted.contradicted().any():
        return None
    about = predicted.scaled(float(np.median(predicted.estimate / predicted.given)))
    share: Any = np.linalg.solve(about.spread, predicted.given)
    known = float(share @ predicted.given)
    factor, sigma = float(share @ predicted.estimate) / known, 1.0 / np.sqrt(known)
    scaled = predicted.scaled(factor)
    before, after = (float(np.sqrt(np.mean(each.away**2))) for each in (predicted, scaled))
    if abs(factor - 1.0) < FAR * sigma or scaled.contradicted().any() or BETTER * after > before:
        return None
    return ScaleError(first, float(predicted.given[0]), len(predicted.given), factor, float(sigma), before, after)


def _named(predicted: PredictedSpacings, names: Sequence[tuple[str, str]]) -> tuple[SpacingError, ...]:
    """Each wrong distance, with its estimate from: the rows alone, if they contradict it; the rows and the right
    distances, if these contradict it; the rows and all other distances, if it is not certain which is wrong.
    """
    result, by_rows, (contradicted, certain) = [], predicted.contradicted(), wrong(predicted)
    for one in np.flatnonzero(contradicted).tolist():
        kept = ~by_rows if not certain[one] else ~contradicted & ~by_rows[one]
        off, sigma = predicted.given_others(kept, one)
        spread = float(np.sqrt(max(sigma**2 - float(predicted.sigma[one]) ** 2, 1e-8)))
        given = float(predicted.given[one])
        least = max(FAR * sigma, LEAST_MM)
        result.append(SpacingError(names[one], given, given - off, spread, bool(certain[one]), least))
    return tuple(result)
