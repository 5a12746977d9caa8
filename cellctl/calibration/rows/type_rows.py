"""What a type of robots tells of the parameters of one: rows that are fitted like measurements.

In tolerances T, a robot is N(0, I) by its robot file, and N(m, P) as one of its type. The rows are what the second
knows besides the first: with the eigenvectors v of P⁻¹ − I, and eigenvalues λ > 0,

    vᵀu = vᵀm (1 + λ)/λ ± 1/√λ,

so that prior and rows together are N(m, P) exactly along v. Where the robots spread as far as the tolerance or further
(λ ≤ 0) there is no row: the tolerance stays, and the evidence scales it as without a type.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self, final

import numpy as np

from cellctl.calibration.model.robot_model import RobotModel
from cellctl.calibration.model.unknowns import State, Tolerances, Unknowns
from cellctl.kinematics import Floats

OF_TYPE = "type"
"""Name of the factor by which a robot is less like its type than the robots of the prior were."""

LEAST_KNOWN = 0.01
"""λ from which on there is a row: below it σ would shrink by less than half a percent."""


@final
@dataclass(frozen=True, eq=False)
class TypePrior:
    """mean (P,) and covariance (P, P) of parameters of robots of one type, in their units, by `names`."""

    names: tuple[str, ...]
    mean: Floats
    covariance: Floats

    def rows(self, model: RobotModel, tolerances: Tolerances) -> TypeRows | None:
        """As rows about those parameters that the model has; None where these tell nothing."""
        of_model = dict(zip(model.names, Unknowns.of(State.alone(model), (), tolerances).sigma, strict=True))
        mine = [index for index, name in enumerate(self.names) if name in of_model]
        names = [self.names[index] for index in mine]
        scale = np.array([of_model[name] for name in names])
        if not mine:
            return None
        mean, covariance = self.mean[mine] / scale, self.covariance[np.ix_(mine, mine)] / np.outer(scale, scale)
        # P⁻¹ − I has the eigenvectors of P
        values, vectors = np.linalg.eigh(covariance)
        known = 1.0 / values - 1.0
        kept = known > LEAST_KNOWN
        if not kept.any():
            return None
        along, known = vectors[:, kept].T, known[kept]
        columns = np.array([model.names.index(name) for name in names])
        return TypeRows(columns, along / scale, along @ mean * (1.0 + known) / known, (1.0 / np.sqrt(known))[:, None])


@final
@dataclass(frozen=True, eq=False)
class TypeRows:
    """Combinations of a robot's parameters as its type has them, in tolerances. columns (C,): of the model's
    parameters; lines (N, C): the combinations, per unit; values (N,); sigma (N, 1).
    """

    columns: Any
    lines: Floats
    values: Floats
    sigma: Floats

    def __len__(self) -> int:
        return len(self.sigma)

    @property
    def quantities(self) -> tuple[str, ...]:
        """One number."""
        return (OF_TYPE,)

    def residual(self, state: State) -> Floats:
        """The robot's combinations minus those of its type (N, 1)."""
        return np.asarray(self.lines @ np.asarray(state.model.deviations)[self.columns] - self.values)[:, None]

    def jacobian(self, state: State) -> Floats:
        """(N, 1, P)."""
        result = np.zeros((len(self), 1, state.width))
        result[:, 0, state.columns[0][self.columns]] = self.lines
        return result

    def errors(self, state: State) -> Floats:
        """Distance from the type (N,), in tolerances."""
        return np.abs(self.residual(state)[:, 0])

    def pick(self, which: Any) -> Self:
        """The rows at an index array or mask."""
        return replace(self, lines=self.lines[which], values=self.values[which], sigma=self.sigma[which])

    def noisier(self, factors: Floats | float) -> Self:
        """The same rows with their standard deviations times `factors` (1,)."""
        return replace(self, sigma=self.sigma * factors)


def of_type(blocks: Sequence[Any]) -> list[TypeRows]:
    """Those of `blocks` that are rows of a type."""
    return [block for block in blocks if isinstance(block, TypeRows)]
