"""A multilayer perceptron, trained by back-propagation with scikit-learn."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.error_maps.samples import Method, Scale, Tuned
from cellctl.kinematics import Floats

HIDDEN = (8, 16, 32)
ALPHAS = (1e-3, 1e-2, 1e-1, 1.0)
"""Candidates of `tuned_perceptron`."""

ROUNDS = 2000
"""Most iterations of a training; one that reaches it has stopped early, which is no error."""


@final
class LibraryMissing(ImportError):
    """An optional library is not installed; the text has the command that installs it."""


@final
@dataclass(frozen=True, eq=False)
class PerceptronMap:
    """A trained perceptron: weights (k, h), …, (h, m) and offsets (h,), …, (m,) from one layer to the next, between
    standardised inputs and outputs.
    """

    inputs: Scale
    outputs: Scale
    weights: tuple[Floats, ...]
    offsets: tuple[Floats, ...]

    def errors(self, inputs: ArrayLike) -> Floats:
        """Errors (N, m) at inputs (N, k), in the units of the samples."""
        at = self.inputs.standardised(np.atleast_2d(np.asarray(inputs, float)))
        for weights, offsets in zip(self.weights[:-1], self.offsets[:-1], strict=True):
            at = np.tanh(at @ weights + offsets)
        return self.outputs.restored(at @ self.weights[-1] + self.offsets[-1])


@final
@dataclass(frozen=True)
class Perceptron(Method):
    """Hidden layers of tanh units, linear outputs; inputs and outputs are standardised.

    hidden: units of the one hidden layer, or of each. alpha: penalty of the squared weights (scikit-learn's). seed: of
    the initial weights. Training minimises the squared error over all samples by L-BFGS with the gradients of
    back-propagation (MLPRegressor of scikit-learn: the extra `baselines`, decision 33). The same samples and seed give
    the same map. A map needs no scikit-learn to predict.
    """

    hidden: int | tuple[int, ...] = 16
    alpha: float = 1e-1
    seed: int = 0

    def fit_checked(self, inputs: Floats, errors: Floats) -> PerceptronMap:
        """The map of errors (N, m) sampled at inputs (N, k). Raises LibraryMissing."""
        of_inputs, of_outputs = Scale.of(inputs), Scale.of(errors)
        trained = self._trained(of_inputs.standardised(inputs), of_outputs.standardised(errors))
        return PerceptronMap(of_inputs, of_outputs, tuple(trained.coefs_), tuple(trained.intercepts_))

    def _trained(self, inputs: Floats, outputs: Floats) -> Any:
        network, unfinished = require_library()
        made = network(
            hidden_layer_sizes=self.hidden,
            activation="tanh",
            solver="lbfgs",
            alpha=self.alpha,
            max_iter=ROUNDS,
            random_state=self.seed,
        )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", unfinished)
            return made.fit(inputs, outputs if outputs.shape[1] > 1 else outputs[:, 0])


def tuned_perceptron(
    *, hidden: Sequence[int | tuple[int, ...]] = HIDDEN, alphas: Sequence[float] = ALPHAS, seed: int = 0
) -> Tuned[Perceptron]:
    """Number of hidden units and penalty by cross-validation.

    On places (N, 3) it is the baseline "MLP on Cartesian position" of the kriging paper (its reference 14), whose
    settings are not published: these are ours.
    """
    return Tuned([Perceptron(units, alpha, seed) for units in hidden for alpha in alphas], seed=seed)


def require_library() -> tuple[Any, type[Warning]]:
    """scikit-learn's perceptron and its warning. Raises LibraryMissing, with the command that installs it."""
    try:
        from sklearn.exceptions import ConvergenceWarning  # an extra: it may be missing
        from sklearn.neural_network import MLPRegressor  # an extra: it may be missing
    except ImportError:
        cure = "pip install 'cellctl[baselines]'"
        raise LibraryMissing(f"the perceptron needs scikit-learn, which is not installed: {cure}") from None
    return MLPRegressor, ConvergenceWarning
