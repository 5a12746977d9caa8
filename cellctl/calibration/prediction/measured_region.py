"""The measured region of a model, and whether new rows make it grow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self, final

import numpy as np

from cellctl.calibration.effects import Discrepancy
from cellctl.calibration.estimation.estimate import Estimate
from cellctl.calibration.prediction.outside_region import doubt
from cellctl.kinematics import Floats

INFORMED = 0.8
"""Rows have informed a combination of parameters if no more than this share of its variance is left. Of a model from 80
positions that takes 10 more, of one from 200 about 30.
"""

KNOWN = 1e-9
"""Combinations known better than this share (of variance, scaled) of the least known one are arithmetic."""

_PLACES = frozenset({"base", "tool", "points", "datums"})


@final
@dataclass(frozen=True, eq=False)
class MeasuredRegion:
    """Where the rows were that determined a model's own parameters, and what it is worth elsewhere.

    lower, upper (n,): least and greatest model angles, rad. spread: a Gaussian process over the postures; the share of
    its variance that these leave at another posture is how far that is outside. None in models from before it was
    kept: there it is `doubt`. within: that share at the rows themselves, on average: it is in their noise already.
    outside_mm: 1 σ, 3-D, mm, of a prediction where all of that variance is left. scatter_mm: by how much the rows
    scatter beyond their stated σ, 1 σ, 3-D, mm: errors of the robot that change too fast for the model to follow.
    """

    lower: Floats
    upper: Floats
    outside_mm: float = 0.0
    spread: Discrepancy | None = None
    within: float = 0.0
    scatter_mm: float = 0.0

    @classmethod
    def of(cls, angles: Floats, outside_mm: float = 0.0, scatter_mm: float = 0.0) -> Self:
        """The region of rows at angles (N, n), rad."""
        spread = Discrepancy.over(angles)
        within = float(spread.remainder(angles).mean())
        return cls(angles.min(axis=0), angles.max(axis=0), outside_mm, spread, within, scatter_mm)

    def with_angles(self, angles: Floats) -> MeasuredRegion:
        """The region of this one and of rows at angles (N, n), rad."""
        if self.spread is None:
            both = np.vstack([angles, self.lower, self.upper])
            return MeasuredRegion(both.min(axis=0), both.max(axis=0), self.outside_mm)
        joined = MeasuredRegion.of(np.vstack([angles, self.spread.centres]), self.outside_mm, self.scatter_mm)
        lower, upper = np.minimum(joined.lower, self.lower), np.maximum(joined.upper, self.upper)
        return replace(joined, lower=lower, upper=upper)

    def sigma(self, q: Floats) -> Floats:
        """1 σ (N,), 3-D, mm, of a prediction at angles q (N, n), rad, besides the model's own."""
        return np.asarray(np.hypot(self.scatter_mm, self.outside(q)))

    def outside(self, q: Floats) -> Floats:
        """The part of `sigma` (N,) that grows with the distance from the rows."""
        if self.spread is None:
            return self.outside_mm * doubt(self.lower, self.upper, q)
        beyond = np.maximum(self.spread.remainder(q) - self.within, 0.0) / (1.0 - self.within)
        return self.outside_mm * np.sqrt(beyond)


def informed(found: Estimate) -> bool:
    """Whether the rows of a fit determined any combination of the robot's own parameters: links, zeros, effects.

    Base, tool, points and datums are places, not the robot's own: rows that find nothing else say nothing of how it
    moves. Without a prior covariance the tolerances are what was known before.
    """
    unknowns = found.unknowns
    mine = unknowns.free & ~np.isin(unknowns.groups, list(_PLACES))
    if not mine.any():
        return False
    columns = np.flatnonzero(mine)
    before = unknowns.known(columns)
    after = found.covariance[np.ix_(columns, columns)] / np.outer(unknowns.sigma[columns], unknowns.sigma[columns])
    return bool(min(_shares(before, after)) <= INFORMED)


def _shares(before: Floats, after: Floats) -> Sequence[float]:
    """What is left of the variance of each combination (generalised eigenvalues of `after` in `before`, (P, P))."""
    values, vectors = np.linalg.eigh(before)
    known = values > KNOWN * values.max()
    root = vectors[:, known] / np.sqrt(values[known])
    return [float(share) for share in np.linalg.eigvalsh(root.T @ after @ root)]
