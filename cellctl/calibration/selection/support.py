"""Whether held-out rows support a residual model: a random function fits any rows, and says little between them.

Of several terms that are tried, each would be kept by chance in 16 of 100 cases at one standard error of its gain, in 2
of 100 at two. Random folds only show that a function interpolates. Whether it also holds beyond the rows is seen where
the first or the last fifth of a joint's range is held out: a spurious function is often far off there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self, TypeAlias, final

import numpy as np

from cellctl.calibration.effects import functions
from cellctl.calibration.estimation.evidence import Factor
from cellctl.calibration.model.parameter import Group
from cellctl.calibration.selection.cross_validation import Folded
from cellctl.calibration.selection.folds import FIFTH, end_folds
from cellctl.kinematics import Bools, Floats

WORTH = 0.01
"""A gain below this share of the previous distance does not justify a term, even if it is significant."""

STANDARD_ERRORS = 2.0
"""A residual model needs a gain of so many of its standard errors; a physical effect, with physical bounds, of one."""

WORSE_AT_END = 1.2
"""The mean error of held-out rows at an end of a joint's range may be this many times that without the residual
model."""

Terms: TypeAlias = tuple[Bools, Mapping[Factor, float]]
"""A model: which of the unknowns (F,) it has, and its logarithms of noise and prior scales."""


@final
@dataclass(frozen=True, slots=True)
class Gain:
    """What a term gains in held-out rows: mean and standard error, mm. needed: of how many standard errors it has to
    be.
    """

    mean: float
    error: float
    needed: float
    worth: float

    @classmethod
    def of(cls, before: Floats, after: Floats, group: Group = "") -> Self:
        """From the errors (N,), mm, of held-out rows without and with the term `group`."""
        gain = before - after
        error = float(gain.std(ddof=1) / np.sqrt(gain.size)) if gain.size > 1 else np.inf
        needed = STANDARD_ERRORS if group in functions() else 1.0
        return cls(float(gain.mean()), error, needed, WORTH * float(before.mean()))

    @property
    def significant(self) -> bool:
        """Whether it is larger than chance explains, and worth a term."""
        return self.mean > max(self.needed * self.error, self.worth)


def worst_end(folded: Folded, q: Floats, before: Terms, after: Terms) -> float:
    """The largest ratio of mean errors, `after` to `before`, of the fifth of the rows at q (N, n), rad, at one end of a
    joint's range, held out; 0 where no joint has rows enough at an end.

    Each ratio is less one standard error: of seven rows (a fifth of 36) it is known to 0.3 only, and one of twelve
    ends would be above any limit by chance.
    """
    ends = end_folds(q, FIFTH)
    if not ends:
        return 0.0
    outer = folded.with_folds(ends)
    without, with_it = outer.predicted(*before).errors, outer.predicted(*after).errors
    stops = np.cumsum([len(end) for end in ends])[:-1]
    return max(_ratio(*pair) for pair in zip(np.split(without, stops), np.split(with_it, stops), strict=True))


def _ratio(before: Floats, after: Floats) -> float:
    """Mean of `after` over that of `before` (N,), less its standard error (delta method for a ratio of means)."""
    if len(before) < 2:
        return 0.0
    mean = max(float(before.mean()), 1e-12)
    ratio = float(after.mean()) / mean
    return ratio - float((after - ratio * before).std(ddof=1)) / (mean * float(np.sqrt(len(before))))
