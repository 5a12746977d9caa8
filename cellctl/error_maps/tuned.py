"""Settings of a baseline, chosen by cross-validation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar, final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.error_maps import ErrorMap
from cellctl.error_maps.samples import Method, grouped_folds, held_out_rms
from cellctl.kinematics import Floats

M = TypeVar("M", bound=Method)

FOLDS = 5


@final
@dataclass(frozen=True, eq=False)
class TunedMap(Generic[M]):
    """A map by the method with the smallest held-out error; `rms` of every candidate, unit of the errors."""

    method: M
    map: ErrorMap
    rms: tuple[float, ...]

    def errors(self, inputs: ArrayLike) -> Floats:
        """Predicted errors (N, m) at inputs (N, k)."""
        return self.map.errors(np.asarray(inputs, float))


@final
@dataclass(frozen=True)
class Tuned(Method, Generic[M]):
    """The first of `candidates` with the smallest RMS of held-out errors, then fitted to all samples.

    folds: random ones, drawn from `seed`; samples with the same inputs share a fold. The points that are reported must
    not be among the samples.
    """

    candidates: Sequence[M]
    folds: int = FOLDS
    seed: int = 0

    def fit_checked(self, inputs: Floats, errors: Floats) -> TunedMap[M]:
        """The map of errors (N, m) sampled at inputs (N, k)."""
        held = grouped_folds(inputs, self.folds, self.seed)
        rms = [held_out_rms(each, inputs, errors, held) for each in self.candidates]
        best = self.candidates[rms.index(min(rms))]
        return TunedMap(best, best.fit_checked(inputs, errors), tuple(rms))
