"""The neural network of the ANN paper: from encoder angles to the joint errors by flexibility."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self, final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.error_maps import ErrorMap
from cellctl.error_maps.motor_flexibility import MotorFlexibility, tcp_errors
from cellctl.error_maps.perceptron import tuned_perceptron
from cellctl.error_maps.samples import Method
from cellctl.kinematics import Floats, SerialChain

HIDDEN = (20,)
ALPHAS = (1e-2, 1e-1, 1.0, 10.0, 100.0)
"""Candidates of the penalty. The labels contain the friction in the currents, which is no function of the joints; with
a small penalty the network learns it as if it were.
"""


@final
@dataclass(frozen=True, eq=False)
class FlexibilityNetwork:
    """A network that predicts Δθ of every joint from the encoder angles alone; no current is needed.

    chain: the identified robot without flexibility. map: joints (N, n), rad → Δθ (N, n), rad.

    Source: ANN-based precision compensation via optimization of point selection, section 3.4: one hidden layer,
    back-propagation. The labels are Δθ by the measured currents at the training points, which are near the task path
    (`cellctl.planning` draws them). Hidden units, training method and stopping are not published: ours are 20 units,
    `Perceptron`, and a penalty by cross-validation of the labels.
    """

    chain: SerialChain
    map: ErrorMap

    @classmethod
    def trained(
        cls,
        flexibility: MotorFlexibility,
        q: ArrayLike,
        currents: ArrayLike,
        *,
        seed: int = 0,
        method: Method | None = None,
    ) -> Self:
        """Trained on rows near the task path: joints (N, n), rad, and currents (N, n), A, measured there.

        seed: of the initial weights and the folds. method: None is a perceptron with `HIDDEN` units and one of
        `ALPHAS`. Raises UnusableSamples, LibraryMissing.
        """
        labels = flexibility.turns(currents)
        chosen = method or tuned_perceptron(hidden=HIDDEN, alphas=ALPHAS, seed=seed)
        return cls(flexibility.chain, chosen.fit(q, labels))

    def turns(self, q: ArrayLike) -> Floats:
        """Joint-angle errors (N, n), rad, at encoder angles (N, n), rad."""
        return self.map.errors(np.asarray(q, float))

    def errors(self, q: ArrayLike) -> Floats:
        """Position errors (N, 3), mm, at encoder angles (N, n), rad."""
        angles = np.asarray(q, float)
        return tcp_errors(self.chain, angles, self.turns(angles))
