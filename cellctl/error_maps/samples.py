"""Samples of an error: checked, standardised; settings of a map chosen by cross-validation over folds of them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, Self, TypeVar, final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.error_maps import ErrorMap
from cellctl.kinematics import Bools, Floats

LEAST = 10
"""Fewer samples fit no map."""

LEAST_SCATTER = 1e-6
"""mm or rad. Values that scatter less are constant: the rest is rounding."""

FAR = 20.0
"""An outlier is this many robust standard deviations from the median."""

USUAL_SHARE, USUAL_SIGMAS = 0.8, 1.2816
"""The robust standard deviation is the distance from the median that 80 % of the samples do not exceed, divided by that
of a normal distribution. Not the usual half of the samples: joint errors of friction are at one of two values, so half
of them may be close together."""


class Method(ABC):
    """A way to fit a map (`ErrorMapMethod`), with its settings. The same samples give the same map.

    Inputs are joints, rad, or places, mm; errors are of any number of components.
    """

    def fit(self, inputs: ArrayLike, errors: ArrayLike) -> ErrorMap:
        """The map of errors (N, m) sampled at inputs (N, k). Raises UnusableSamples."""
        return self.fit_checked(*checked(inputs, errors))

    @abstractmethod
    def fit_checked(self, inputs: Floats, errors: Floats) -> ErrorMap:
        """The same for samples that were `checked`, or a part of such."""


@final
class UnusableSamples(ValueError):
    """No map can be fitted to these samples; the text states which sample, and the cure."""


@final
@dataclass(frozen=True, eq=False)
class Scale:
    """Mean and standard deviation (k,) of columns. A constant column has deviation 0, and standardised values of 0."""

    mean: Floats
    deviation: Floats

    @classmethod
    def of(cls, values: Floats) -> Self:
        """Of values (N, k)."""
        deviation = values.std(axis=0)
        return cls(values.mean(axis=0), np.where(deviation < LEAST_SCATTER, 0.0, deviation))

    def standardised(self, values: Floats) -> Floats:
        """Values (..., k) without a unit."""
        away = values - self.mean
        return np.asarray(np.divide(away, self.deviation, out=np.zeros_like(away), where=self.deviation > 0.0))

    def restored(self, values: Floats) -> Floats:
        """Standardised values (..., k) with their unit."""
        return np.asarray(self.mean + self.deviation * values)


def checked(inputs: ArrayLike, errors: ArrayLike) -> tuple[Floats, Floats]:
    """Samples as arrays (N, k), (N, m). All k inputs have one unit. Repeated inputs and constant errors are no mistake.

    Raises UnusableSamples for arrays that do not fit together, numbers that are not finite, fewer than `LEAST`
    samples, inputs that are all equal, and for an outlier: a sample whose inputs, or one component of its errors, are
    more than `FAR` robust standard deviations from the median. A map would spread its error over all inputs near it.
    """
    at, found = np.asarray(inputs, float), np.asarray(errors, float)
    if at.ndim != 2 or found.ndim != 2 or len(at) != len(found):
        raise UnusableSamples(f"inputs {at.shape} and errors {found.shape}: both need one row for each sample")
    bad = np.flatnonzero(~(np.isfinite(at).all(axis=1) & np.isfinite(found).all(axis=1)))
    if bad.size:
        raise UnusableSamples(f"sample {bad[0] + 1} has a number that is not finite: leave that sample out")
    if len(at) < LEAST:
        raise UnusableSamples(f"{len(at)} samples: an error map needs at least {LEAST}; measure more points")
    if (np.ptp(at, axis=0) < LEAST_SCATTER).all():
        raise UnusableSamples("all samples have the same inputs: measure at different postures")
    _refuse_outlier("the inputs", at)
    for component, values in enumerate(found.T, 1):
        _refuse_outlier(f"component {component} of the error", values[:, None])
    return at, found


def _refuse_outlier(what: str, values: Floats) -> None:
    """Distance of values (N, k) from their median; without a rule where `USUAL_SHARE` of them are equal."""
    away = np.linalg.norm(values - np.median(values, axis=0), axis=1)
    sigma, worst = float(np.quantile(away, USUAL_SHARE)) / USUAL_SIGMAS, int(np.argmax(away))
    if sigma >= LEAST_SCATTER and away[worst] > FAR * sigma:
        far = f"{away[worst] / sigma:.0f} robust standard deviations from the median of all samples"
        raise UnusableSamples(f"{what} of sample {worst + 1}: {far}; measure that sample again or leave it out")


def grouped_folds(inputs: Floats, folds: int, seed: int) -> list[Bools]:
    """Random folds of samples (N, k) as masks (N,) of the held-out ones.

    Samples with the same inputs are in one fold: a repeat would judge its own model.
    """
    _, group = np.unique(inputs, axis=0, return_inverse=True)
    group = group.reshape(-1)
    count = int(group.max()) + 1
    place = np.random.default_rng(seed).permutation(count) % min(folds, count)
    return [np.asarray(place[group] == fold) for fold in range(min(folds, count))]


def held_out_rms(method: Method, inputs: Floats, errors: Floats, folds: Sequence[Bools]) -> float:
    """Root mean square of the length of the held-out errors that `method` leaves, over all folds."""
    squares = 0.0
    for held in folds:
        left = errors[held] - method.fit_checked(inputs[~held], errors[~held]).errors(inputs[held])
        squares += float(np.sum(left**2))
    return float(np.sqrt(squares / len(inputs)))


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
