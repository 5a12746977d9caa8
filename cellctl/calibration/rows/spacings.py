"""Certified distances between fixed points."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self, final

import numpy as np

from cellctl.calibration.model.unknowns import State
from cellctl.kinematics import Floats


@final
@dataclass(frozen=True, eq=False)
class SpacingRows:
    """Certified distances between points: spheres of a plate, sockets. pairs (N, 2): indices of points; mm (N,);
    sigma (N, 1), mm.
    """

    pairs: Any
    mm: Floats
    sigma: Floats

    def __len__(self) -> int:
        return len(self.sigma)

    @property
    def quantities(self) -> tuple[str, ...]:
        """One distance, whose σ is the certificate's."""
        return ("certified",)

    def residual(self, state: State) -> Floats:
        """Distance of the points minus the certified one (N, 1), mm."""
        return np.asarray(np.linalg.norm(self._between(state), axis=-1) - self.mm)[:, None]

    def jacobian(self, state: State) -> Floats:
        """(N, 1, P): the unit vector between the points, in their columns."""
        between = self._between(state)
        unit = between / np.maximum(np.linalg.norm(between, axis=-1, keepdims=True), 1e-9)
        result, each = np.zeros((len(self), 1, state.width)), np.arange(len(self))
        points = result[:, 0, state.of_points].reshape(len(self), -1, 3)
        points[each, self.pairs[:, 0]], points[each, self.pairs[:, 1]] = unit, -unit
        result[:, 0, state.of_points] = points.reshape(len(self), -1)
        return result

    def errors(self, state: State) -> Floats:
        """Deviation from the certificate (N,), mm."""
        return np.abs(self.residual(state)[:, 0])

    def pick(self, which: Any) -> Self:
        """The rows at an index array or mask."""
        return replace(self, pairs=self.pairs[which], mm=self.mm[which], sigma=self.sigma[which])

    def noisier(self, factors: Floats) -> Self:
        """The same rows with their standard deviations times `factors` (1,)."""
        return replace(self, sigma=self.sigma * factors)

    def _between(self, state: State) -> Floats:
        return np.asarray(state.points[self.pairs[:, 0]] - state.points[self.pairs[:, 1]])
