"""Certified distances that do not go together with the rows, or with each other.

A certificate is a measurement too, and it may be the wild one: a wrong pair of spheres, a typing error, inches. So the
robot is identified from rows alone, without any certificate. What these deny by themselves is wrong, or all by one
factor; only then each distance is foretold from rows and from the others that are not denied. Where leaving out any of
several makes the rest agree, all of them are named. A robot that obeys rows and certificate alike clears all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np

from cellctl.calibration.estimation.estimate import Estimate
from cellctl.calibration.estimation.identify import Identification, Weights, identify, identify_kept
from cellctl.calibration.estimation.task import Task
from cellctl.calibration.mistakes.foretold import FAR, Foretold, wrong
from cellctl.calibration.mistakes.second_centres import with_best_centres
from cellctl.calibration.rows import PlaneRows, SocketRows, SpacingRows, TouchRows
from cellctl.calibration.rows.row_blocks import Mixture
from cellctl.calibration.selection.ladder import climb
from cellctl.kinematics import Bools

SAMPLE = 300
"""Rows of instruments that foretell the distances, and as many touches and visits, evenly from all points."""

SAMPLE_OF_EACH = 20
"""So many of each instrument's rows, and of each point's, are always among them."""

TOUCHES_AT_LEAST = 5
"""Of fewer touches on a sphere two centres, or a ring of them, may be as good: its distances are not judged."""

FITTING = 3.0
"""Standard deviations of χ² within which a certificate fits a robot that also obeys the rows."""

FEW = 3
"""Fewer different distances than this have no factor in common: each is named."""

BETTER = 4.0
"""By how many times nearer to what the rows say a common factor brings the distances."""


@final
@dataclass(frozen=True, slots=True)
class DeniedSpacing:
    """A certified distance, mm, between two points that is not what the rows and the other distances say, mm ± 1 σ.

    certain: whether it is this one that is wrong; else the rows cannot tell which of those that are named.
    """

    between: tuple[str, str]
    given: float
    said: float
    sigma: float
    certain: bool

    @property
    def what(self) -> str:
        """`spacing S1–S2: 503 mm given, these rows say 403.1 ± 0.1 mm`."""
        digits = max(0, min(3, 1 - int(np.floor(np.log10(self.sigma)))))
        say = "these rows say" if self.certain else "these rows and the other spacings say"
        given = f"spacing {self.between[0]}–{self.between[1]}: {self.given:g} mm given"
        return f"{given}, {say} {self.said:.{digits}f} ± {self.sigma:.{digits}f} mm"


@final
@dataclass(frozen=True, slots=True)
class DeniedScale:
    """All certified distances that the rows can judge, `count` of them, are wrong by one factor ± 1 σ.

    between, given: the first of them, mm. before, after: RMS, mm, by which they are off what the rows say, as given and
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
        """`all 120 spacings that these rows know: × 25.40 brings them from 587 to 0.19 mm off what these rows say`."""
        factor = f"{self.factor:.{max(0, min(6, -int(np.floor(np.log10(self.sigma)))))}f}"
        off = f"from {self.before:.3g} to {self.after:.2g} mm off what these rows say"
        return f"all {self.count} spacings that these rows know: × {factor} brings them {off}"


def denied_spacings(task: Task) -> tuple[DeniedSpacing | DeniedScale, ...]:
    """The certified distances of `task` that rows or other distances deny; none where there is nothing to tell."""
    if task.spacings is None or not len(task.spacings) or task.rows.size < 2 * task.registering:
        return ()
    try:
        found = _denied(task, task.spacings)
        if not found or not task.candidates:
            return found
        climbed = climb(replace(task, spacings=None), task.rows.pick(_sample(task.rows)))  # a term may be missing
        return _denied(climbed.task, task.spacings)
    except np.linalg.LinAlgError:
        return ()


def _denied(task: Task, spacings: SpacingRows) -> tuple[DeniedSpacing | DeniedScale, ...]:
    groups = task.groups if task.prior is not None else None
    rows = task.rows.pick(_sample(task.rows))
    alone = replace(task, rows=rows, spacings=None, candidates=None, groups=groups)
    found = identify(alone)
    used = rows.pick(np.array(found.used))
    judged = _between(spacings, _known(used, len(task.points)))
    if not found.identified.converged or not _suspected(judged, found.identified) or _fits(alone, judged, found):
        return ()
    best, unsure = with_best_centres(found.identified, used.noisier(found.noise))
    judged = _between(judged, ~unsure)
    return _told(task, judged, best) if _suspected(judged, best) else ()


def _between(spacings: SpacingRows, points: Bools) -> SpacingRows:
    """Those between two of the `points` (S,)."""
    return spacings.pick(points[spacings.pairs].all(axis=1))


def _suspected(spacings: SpacingRows, found: Estimate) -> bool:
    """Whether any is denied."""
    return len(spacings) > 0 and bool(wrong(Foretold.of(spacings, found))[0].any())


def _told(task: Task, spacings: SpacingRows, found: Estimate) -> tuple[DeniedSpacing | DeniedScale, ...]:
    """The factor that they are wrong by together, or each that is denied."""
    foretold = Foretold.of(spacings, found)
    names = [(task.points[first], task.points[second]) for first, second in spacings.pairs]
    scale = _scale(foretold, names[0])
    return (scale,) if scale is not None else _named(foretold, names)


def _sample(rows: Mixture) -> Any:
    """Which rows (N,) foretell the distances: of instruments, which may hold thousands, and of points as many."""
    owner = np.concatenate(
        [
            block.point if isinstance(block, TouchRows | SocketRows | PlaneRows) else np.full(len(block), -1 - number)
            for number, block in enumerate(rows.blocks)
        ]
    )
    chosen, rng = np.zeros(len(rows), bool), np.random.default_rng(0)
    for owners in (np.unique(owner[owner < 0]), np.unique(owner[owner >= 0])):
        for one in owners:
            mine = rng.permutation(np.flatnonzero(owner == one))
            chosen[mine[: max(SAMPLE // len(owners), SAMPLE_OF_EACH)]] = True
    return chosen


def _known(rows: Mixture, points: int) -> Bools:
    """Which points (S,) have rows enough for one place alone."""
    told = np.zeros(points, int)
    for block in rows.blocks:
        if isinstance(block, TouchRows | SocketRows):
            each = 1 if isinstance(block, TouchRows) else TOUCHES_AT_LEAST
            told += each * np.bincount(block.point, minlength=points)
    return told >= TOUCHES_AT_LEAST


def _fits(alone: Task, spacings: SpacingRows, found: Identification) -> bool:
    """Whether a robot no further from nominal, with rows no noisier, obeys the certificate too."""
    weights = Weights(found.noise, found.loosened)
    _, weighed = identify_kept(replace(alone, spacings=spacings), alone.rows.pick(np.array(found.used)), weights)
    more, count = weighed.found.cost - found.identified.cost, len(spacings)
    return weighed.found.converged and bool(more < count + FITTING * np.sqrt(2.0 * count))


def _scale(foretold: Foretold, first: tuple[str, str]) -> DeniedScale | None:
    """The one factor that brings all distances to what the rows say, where these deny any and there is one."""
    if np.unique(foretold.given).size < FEW or not foretold.denied().any():
        return None
    about = foretold.scaled(float(np.median(foretold.said / foretold.given)))
    share: Any = np.linalg.solve(about.spread, foretold.given)
    known = float(share @ foretold.given)
    factor, sigma = float(share @ foretold.said) / known, 1.0 / np.sqrt(known)
    scaled = foretold.scaled(factor)
    before, after = (float(np.sqrt(np.mean(each.away**2))) for each in (foretold, scaled))
    if abs(factor - 1.0) < FAR * sigma or scaled.denied().any() or BETTER * after > before:
        return None
    return DeniedScale(first, float(foretold.given[0]), len(foretold.given), factor, float(sigma), before, after)


def _named(foretold: Foretold, names: Sequence[tuple[str, str]]) -> tuple[DeniedSpacing, ...]:
    """Each that is wrong, with what is said of it by: the rows alone, if they deny it; they and the undisputed
    distances, if these do; they and all others, where nobody can tell which.
    """
    result, by_rows, (denied, certain) = [], foretold.denied(), wrong(foretold)
    for one in np.flatnonzero(denied).tolist():
        kept = ~by_rows if not certain[one] else ~denied & ~by_rows[one]
        off, sigma = foretold.given_others(kept, one)
        said = float(np.sqrt(max(sigma**2 - float(foretold.sigma[one]) ** 2, 1e-8)))
        given = float(foretold.given[one])
        result.append(DeniedSpacing(names[one], given, given - off, said, bool(certain[one])))
    return tuple(result)
