"""The difference of two models' errors on the same held-out rows, with an interval that allows for overlapping folds.

With J folds the models of two folds share most of their rows, so the differences d_j of the folds are not independent:
their variance S² / J is too small, and a paired t test finds differences where there are none in up to half of all
cases. Nadeau and Bengio (2003, Inference for the generalization error, Machine Learning 52, section 3) estimate the
variance of the mean of d_j by

    (1/J + n_test / n_train) S²,    S²: sample variance of d_j

with J − 1 degrees of freedom. With one split there is no overlap: rows are the sample.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self, final

import numpy as np

from cellctl.calibration.distributions import t_ppf
from cellctl.calibration.verdict.proof import Split
from cellctl.kinematics import Floats


@final
@dataclass(frozen=True, slots=True)
class Difference:
    """Mean of b − a, mm, and its 95 % interval; infinite where two folds or rows are missing."""

    mean: float
    low: float
    high: float

    @classmethod
    def of(cls, a: Floats, b: Floats, split: Split) -> Self:
        """Of errors (N,), mm, of the held-out rows of `split`, in its order."""
        folds = fold_means(b - a, split)
        if len(folds) > 1:
            overlap = float(np.mean([len(test) / len(fit) for fit, test in split.judged]))
            return cls._about(folds, 1.0 / len(folds) + overlap)
        return cls._about(b - a, 1.0 / len(b)) if len(b) else cls(0.0, -np.inf, np.inf)

    @classmethod
    def _about(cls, sample: Floats, factor: float) -> Self:
        """factor: of the sample's variance, for that of its mean."""
        mean = float(sample.mean())
        if len(sample) < 2:
            return cls(mean, -np.inf, np.inf)
        half = float(t_ppf(0.975, len(sample) - 1)) * float(np.sqrt(factor * sample.var(ddof=1)))
        return cls(mean, mean - half, mean + half)

    @property
    def decided(self) -> bool:
        """Whether the interval is on one side of 0."""
        return self.low > 0.0 or self.high < 0.0


def fold_means(values: Floats, split: Split) -> Floats:
    """Mean of the values (N,) of each fold's held-out rows (J,)."""
    ends: Sequence[int] = np.cumsum([len(test) for _, test in split.judged])[:-1].tolist()
    return np.array([part.mean() for part in np.split(values, ends) if part.size])
