"""What the other terms of a model leave: a smooth random function of the joints, one for each axis."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar, Self, final

import numpy as np
from scipy.linalg import solve_triangular
from scipy.spatial.distance import cdist

from cellctl.calibration.effects.effect import STORED, EffectInputs
from cellctl.calibration.model.parameter import MM, Group, Parameter, Phrase
from cellctl.calibration.model.postures import Postures
from cellctl.calibration.residuals.residual_model import ResidualModel
from cellctl.kinematics import Floats, SerialChain

EXPECTED_MM = 0.1
"""1 σ on each axis before the data scale it; a UR10 leaves 0.03 (full model) … 0.4 mm (geometry alone)."""

LENGTHS_RAD = (1.0, 1.5, 2.0, 3.0, 4.5, 6.0)
"""Postures this far apart (root of the summed squares over the joints) share 60 % of it: weight and geometry, whose
remainders it stands for, change over some tens of degrees. Longer where rows are too sparse to tell each other of less.
"""

TOLD = 0.1
"""Half of the rows leave at most this share of the variance at the others, on average; else the length is too short."""

CENTRES = 64
MOST = 1000
ALIKE_RAD = 0.05
_JITTER = 1e-6
_PHRASE = Phrase("discrepancy", "discrepancy")


@final
@dataclass(frozen=True, eq=False)
class Discrepancy(ResidualModel):
    """A Gaussian process δ(q) on each axis of the robot's base frame, squared exponential in the joint angles.

    centres (M, n): postures, rad, at which it is expanded (Nyström): δ = Σ φ_m(q) κ_m with κ ~ N(0, expected²), mm.
    What the centres do not span (`remainder`) is no part of the model's prediction, and a part of its uncertainty.
    Kennedy and O'Hagan 2001 (doi 10.1111/1467-9868.00294); needs: rows at different postures.
    """

    centres: Floats
    length_rad: float = field(default=LENGTHS_RAD[0], metadata={STORED: "length"})
    expected: float = EXPECTED_MM
    _root: Floats = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if self.length_rad <= 0.0:
            raise ValueError("the length of a discrepancy is above 0")
        square = self._kernel(self.centres) + _JITTER * np.eye(len(self.centres))
        object.__setattr__(self, "_root", np.linalg.cholesky(square))

    @classmethod
    def over(cls, q: Floats) -> Self:
        """Expanded at up to `CENTRES` of the postures q (N, n), rad."""
        some = q[np.random.default_rng(len(q)).permutation(len(q))[:MOST]]
        half, others = some[::2], some[1::2]
        for length in LENGTHS_RAD[:-1]:
            if not len(others) or cls(_spread(half), length).remainder(others).mean() <= TOLD:
                return cls(_spread(q), length)
        return cls(_spread(q), LENGTHS_RAD[-1])

    group: ClassVar[Group] = "discrepancy"
    title: ClassVar[str] = "Discrepancy"
    chosen: ClassVar = "never"

    @classmethod
    def of_inputs(cls, setup: EffectInputs) -> Self:
        """Over the postures of the rows."""
        return cls.over(setup.at.q)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Three for each centre, mm."""
        return tuple(
            Parameter(f"discrepancy{m + 1}_{axis}", MM, self.group, f"discrepancy{m + 1} {axis.upper()}", _PHRASE)
            for m in range(len(self.centres))
            for axis in "xyz"
        )

    @property
    def sigma(self) -> Floats:
        """Prior 1 σ about 0, mm."""
        return np.full(len(self.parameters), self.expected)

    def suits(self, joints: int) -> bool:
        """Whether its postures are those of so many joints."""
        return bool(self.centres.shape[1] == joints)

    def shifts(self, nominal: SerialChain, at: Postures) -> Floats:
        """Ψ (N, 3, 3M): φ of each centre, on each axis."""
        basis = self._basis(at.q)
        return np.asarray((basis[:, None, :, None] * np.eye(3)[:, None, :]).reshape(len(basis), 3, 3 * basis.shape[1]))

    def variance(self, at: Postures) -> Floats:
        """What the centres leave open (N,), mm² on each axis."""
        return self.expected**2 * self.remainder(at.q)

    def outside(self, at: Postures) -> Floats:
        """The share (N,) of its variance that the centres leave."""
        return self.remainder(at.q)

    def remainder(self, q: Floats) -> Floats:
        """The share (N,) of the prior variance at q (N, n), rad, that the centres leave: 0 at them, 1 far away."""
        return np.asarray(np.clip(1.0 - np.sum(self._basis(q) ** 2, axis=1), 0.0, 1.0))

    def _basis(self, q: Floats) -> Floats:
        """φ (N, M)."""
        return np.asarray(solve_triangular(self._root, self._kernel(q).T, lower=True, check_finite=False).T)

    def _kernel(self, q: Floats) -> Floats:
        return np.asarray(np.exp(-0.5 * cdist(q, self.centres, "sqeuclidean") / self.length_rad**2))


def _spread(q: Floats) -> Floats:
    """At most `CENTRES` of the postures q (N, n), each the farthest from those before; no two alike."""
    chosen = [int(np.argmin(np.linalg.norm(q - q.mean(axis=0), axis=1)))]
    distance = np.linalg.norm(q - q[chosen[0]], axis=1)
    while len(chosen) < CENTRES and distance.max() > ALIKE_RAD:
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.linalg.norm(q - q[chosen[-1]], axis=1))
    return q[chosen]
