"""The interface of a residual model beyond that of an effect: its remaining variance and its region."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Self, final

import numpy as np

from cellctl.calibration.effects.effect import Effect
from cellctl.calibration.model.postures import Postures
from cellctl.kinematics import Floats


@final
@dataclass(frozen=True, eq=False)
class Remainder:
    """What the other terms of a model leave: q (N, n), rad; errors (N, 3), mm, of the TCP along the axes of the base;
    known (3, N, N), mm²: covariance of the part of each axis' errors that the other terms may still explain.
    """

    q: Floats
    errors: Floats
    known: Floats


class ResidualModel(Effect):
    """A random function of the posture, as a sum of given functions: its amounts are their coefficients.

    It is estimated together with everything else of a model (decision 28): `of_inputs` chooses the functions, the
    estimator fits the amounts, `turns` and `shifts` apply them. Single amounts have no meaning: they are left out of
    lists of parameters, and of the search for outliers.

    The part that the given functions do not span is counted once: either by the measured region, whose postures are
    those of the rows (`far_sigma`), or by the model's own region (`variance`, `outside`).
    """

    __slots__ = ()

    def variance(self, at: Postures) -> Floats:
        """Variance of the function that the amounts leave open at each posture (N,): mm² of the TCP on each axis. Every
        σ of a prediction includes it.
        """
        return np.zeros(len(at))

    def outside(self, at: Postures) -> Floats:
        """How far each posture (N,) is outside this model's region: 0 to 1, a share of variance. The
        measured region ends where this is large."""
        return np.zeros(len(at))

    def far_sigma(self, sigma: Floats) -> float:
        """1 σ on each axis, mm, of the function where nothing was measured, with the prior 1 σ (K,) of its amounts. The
        measured region adds the share of it that its own postures leave."""
        return 0.0

    def fitted_to(self, left: Remainder) -> Self | None:
        """The same with its settings (lengths, weights) chosen for these rows; None where they do not support it."""
        return self

    def reduced(self, bands: Collection[str]) -> Self:
        """The same without the amounts whose band (`Parameter.band`) is not among `bands`."""
        return self

    def fewer_bands(self) -> Sequence[frozenset[str]]:
        """Sets of bands to leave out, one at a time, where the whole model fails at the ends of the joint ranges."""
        return ()
