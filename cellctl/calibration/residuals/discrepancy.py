"""Remaining error besides a model's other terms: a smooth random function of the joints, one for each axis.

**Model.** A model that lacks something (gear, bearings, bending) leaves an error that depends on the joints:

    y = f(q; θ) + δ(q) + ε,    δ_a ~ GP(0, s² k),  a = x, y, z,    k(q, q') = exp(−‖q − q'‖²/2ℓ²).

Taken for noise, δ biases θ and makes σ too small, as its values at neighbouring postures are not independent: over a
region of size ℓ a thousand rows know the mean of δ no better than one. As a Gaussian process *inside* the fit it
competes with θ by their priors, and the variance that the rows leave of it widens σ away from them (Kennedy and O'Hagan
2001, Bayesian calibration of computer models, doi 10.1111/1467-9868.00294; their ρ is 1 here).

**Estimate.** By the expansion δ = Σ_m φ_m(q) κ_m at M centres (`PostureBasis`) it is linear in κ ~ N(0, s²), and θ and
κ are estimated together as any other amounts: generalised least squares with the covariance s² φφᵀ + σ² I of the rows,
without a matrix of that size. s is `expected` times the prior scale that the evidence finds; ℓ depends on the postures
alone.

**Confounding.** What ∂f/∂θ spans, δ spans as well in part: a constant δ is a moved base. The priors decide, s against
the tolerances; a δ that is not needed would take from θ. So it joins only where residuals are larger than noise and
tolerances predict, by evidence, and only if it predicts held-out rows better (`identify`). A flat prior (base, tool)
always wins against s: there is no such exchange.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar, Self, final

import numpy as np

from cellctl.calibration.model.effect import STORED, EffectInputs, OnlineTerms
from cellctl.calibration.model.parameter import MM, Group, Parameter, Phrase
from cellctl.calibration.model.postures import Postures
from cellctl.calibration.model.residual_model import LENGTHS_RAD, PostureBasis, ResidualModel
from cellctl.kinematics import Floats, SerialChain

EXPECTED_MM = 0.1
"""1 σ on each axis before the data scale it; a UR10 leaves 0.03 (full model) … 0.4 mm (geometry alone)."""

_PHRASE = Phrase("discrepancy", "discrepancy")


@final
@dataclass(frozen=True, eq=False)
class Discrepancy(ResidualModel):
    """A Gaussian process δ(q) on each axis of the robot's base frame, squared exponential in the joint angles.

    centres (M, n): postures, rad, at which it is expanded (`PostureBasis`): δ = Σ φ_m(q) κ_m with κ ~ N(0, expected²),
    mm. The part that the centres do not span is not predicted. It belongs to the uncertainty: the measured region has
    the same basis, and adds it by `far_sigma`.
    """

    centres: Floats
    length_rad: float = field(default=LENGTHS_RAD[0], metadata={STORED: "length"})
    expected: float = EXPECTED_MM
    basis: PostureBasis = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "basis", PostureBasis(self.centres, self.length_rad))

    group: ClassVar[Group] = "discrepancy"
    title: ClassVar[str] = "Discrepancy"
    chosen: ClassVar = "by evidence"

    @classmethod
    def of_inputs(cls, setup: EffectInputs) -> Self:
        """Over the postures of the rows."""
        basis = PostureBasis.over(setup.at.q)
        return cls(basis.centres, basis.length_rad)

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
        basis = self.basis.values(at.q)
        return np.asarray((basis[:, None, :, None] * np.eye(3)[:, None, :]).reshape(len(basis), 3, 3 * basis.shape[1]))

    def far_sigma(self, sigma: Floats) -> float:
        """Its prior σ: far from the rows nothing is known of it."""
        return float(sigma.max())

    def add_online(self, amounts: Floats, terms: OnlineTerms) -> None:
        """A squared exponential about each centre."""
        scale = np.full_like(self.centres, 1.0 / self.length_rad)
        terms.nodes.append((self.centres * scale, scale, self.basis.kernel_weights(amounts.reshape(-1, 3))))
