"""Certified distances that do not go together with the rows, or with each other.

A certificate is a measurement too, and it may be the wild one: a wrong pair of spheres, a typing error, inches. So the
robot is identified from rows alone, without any certificate, and each distance is foretold from that and from the other
distances. One that is far from it is named; where leaving out any of several makes the rest agree, all of them are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np

from cellctl.calibration.identify import identify
from cellctl.calibration.rows import SpacingRows
from cellctl.calibration.task import Task
from cellctl.kinematics import Bools, Floats

FAR = 6.0
"""Standard deviations, of certificate and foretelling together, from which on a distance is denied."""

LEAST_MM = 0.3
"""Nothing smaller is denied: as much may be what the robot bends, where the model is geometry alone."""

SAMPLE = 300
"""Rows that foretell the distances."""


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


def denied_spacings(task: Task) -> tuple[DeniedSpacing, ...]:
    """The certified distances of `task` that rows or other distances deny; none where there is nothing to tell."""
    spacings = task.spacings
    if spacings is None or not len(spacings) or task.rows.size < 2 * task.registering:
        return ()
    try:
        away, spread = _foretold(task, spacings)
        wrong, certain = _wrong(away, spread)
    except np.linalg.LinAlgError:
        return ()
    return tuple(_named(task, spacings, away, spread, wrong, int(one), certain) for one in np.flatnonzero(wrong))


def _foretold(task: Task, spacings: SpacingRows) -> tuple[Floats, Floats]:
    """How far each distance is beyond what the rows alone say (K,), mm, and the covariance (K, K) of that."""
    sample = np.sort(np.random.default_rng(0).permutation(len(task.rows))[:SAMPLE])
    groups = task.groups if task.prior is not None else None
    alone = replace(task, rows=task.rows.pick(sample), spacings=None, candidates=None, groups=groups)
    found = identify(alone).identified
    lines = spacings.jacobian(found.state)[:, 0]
    own = np.diag(spacings.sigma[:, 0] ** 2)
    return -spacings.residual(found.state)[:, 0], lines @ found.covariance @ lines.T + own


def _wrong(away: Floats, spread: Floats) -> tuple[Bools, bool]:
    """Which distances (K,) are wrong, and whether it is sure that it is these."""
    every = np.ones(len(away), bool)
    if not _denied(away, spread, every).any():
        return ~every, True
    without = [every & (np.arange(len(away)) != one) for one in range(len(away))]
    cures = np.array([not _denied(away, spread, kept).any() for kept in without])
    if cures.any():
        return cures, int(np.count_nonzero(cures)) == 1
    kept = every.copy()
    while (denied := _denied(away, spread, kept)).any():
        times = [_times(away, spread, kept, one) if denied[one] else 0.0 for one in range(len(away))]
        kept[int(np.argmax(times))] = False
    return ~kept, True


def _denied(away: Floats, spread: Floats, kept: Bools) -> Bools:
    """Which of the `kept` (K,) are denied by the rows and the others kept."""
    return np.array([bool(kept[one]) and _times(away, spread, kept, one) > 1.0 for one in range(len(away))])


def _times(away: Floats, spread: Floats, kept: Bools, one: int) -> float:
    """By how many times what is let pass a distance is off."""
    off, sigma = _given_others(away, spread, kept, one)
    return abs(off) / max(FAR * sigma, LEAST_MM)


def _given_others(away: Floats, spread: Floats, kept: Bools, one: int) -> tuple[float, float]:
    """How far distance `one` is off, given the other `kept` ones, mm, and the 1 σ of that."""
    others = np.flatnonzero(kept & (np.arange(len(away)) != one))
    share: Any = np.linalg.solve(spread[np.ix_(others, others)], spread[others, one])
    variance = float(spread[one, one] - spread[one, others] @ share)
    return float(away[one] - share @ away[others]), float(np.sqrt(max(variance, 1e-12)))


def _named(
    task: Task, spacings: SpacingRows, away: Floats, spread: Floats, wrong: Bools, one: int, certain: bool
) -> DeniedSpacing:
    kept = ~wrong if certain else np.ones(len(away), bool)
    off, sigma = _given_others(away, spread, kept, one)
    first, second = spacings.pairs[one]
    own = float(spacings.sigma[one, 0])
    said = float(np.sqrt(max(sigma**2 - own**2, 1e-8)))
    given = float(spacings.mm[one])
    return DeniedSpacing((task.points[first], task.points[second]), given, given - off, said, certain)
