"""Samples of an error: what a map is fitted to, and the folds that tune it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.error_maps import ErrorMap
from cellctl.kinematics import Bools, Floats

LEAST = 10
"""Fewer samples fit no map."""

FAR = 20.0
"""A sample this many times further from the median than half of all samples is an outlier."""


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


def checked(inputs: ArrayLike, errors: ArrayLike) -> tuple[Floats, Floats]:
    """Samples as arrays (N, k), (N, m). All k inputs have one unit, and all m errors.

    Raises UnusableSamples for arrays that do not fit together, numbers that are not finite, fewer than `LEAST`
    samples, inputs that are all equal, and for an outlier.
    """
    at, found = np.asarray(inputs, float), np.asarray(errors, float)
    if at.ndim != 2 or found.ndim != 2 or len(at) != len(found):
        raise UnusableSamples(f"inputs {at.shape} and errors {found.shape}: both need one row for each sample")
    bad = np.flatnonzero(~(np.isfinite(at).all(axis=1) & np.isfinite(found).all(axis=1)))
    if bad.size:
        raise UnusableSamples(f"sample {bad[0] + 1} has a number that is not finite: leave that sample out")
    if len(at) < LEAST:
        raise UnusableSamples(f"{len(at)} samples: an error map needs at least {LEAST}; measure more points")
    if not np.ptp(at, axis=0).any():
        raise UnusableSamples("all samples have the same inputs: measure at different postures")
    for what, values in (("inputs", at), ("error", found)):
        _refuse_outliers(what, values)
    return at, found


def _refuse_outliers(what: str, values: Floats) -> None:
    away = np.linalg.norm(values - np.median(values, axis=0), axis=1)
    usual, worst = float(np.median(away)), int(np.argmax(away))
    if 0.0 < FAR * usual < away[worst]:
        times = f"{away[worst] / usual:.0f} times as far from the median as half of the samples"
        raise UnusableSamples(f"the {what} of sample {worst + 1}: {times}; correct that sample or leave it out")


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
