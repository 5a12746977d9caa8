"""The anisotropic field: a smooth error on each axis, with a length of each joint that the rows determine."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar, Self, final

import numpy as np

from cellctl.calibration.effects.effect import EffectInputs
from cellctl.calibration.model.parameter import MM, Group, Parameter, Phrase
from cellctl.calibration.model.postures import Postures
from cellctl.calibration.residuals.axis_process import LENGTH_RAD, AxisProcess, LogNormal, Priors
from cellctl.calibration.residuals.posture_basis import PostureBasis, spread
from cellctl.calibration.residuals.residual_model import Remainder, ResidualModel
from cellctl.kinematics import Floats, SerialChain

ROWS_AT_LEAST = 30
"""Fewer rows do not determine a length of each joint."""

CENTRES = 128

PRIORS = Priors(LENGTH_RAD, LogNormal(0.1, 1.5, 1e-3, 3.0), LogNormal(0.05, 2.0, 1e-3, 3.0))
"""Amplitude and nugget, mm, of what geometry and effects leave: see `discrepancy.EXPECTED_MM`."""

SHOWN = 1.0
"""Nats for each hyper-parameter by which all axes together have to raise the marginal likelihood (Akaike)."""

_PHRASE = Phrase("field", "field")


@final
@dataclass(frozen=True, eq=False)
class JointField(ResidualModel):
    """A Gaussian process on each axis of the robot's base frame, squared exponential in the joint angles.

    centres (M, n): postures, rad, at which it is expanded. lengths (3, n): for x, y, z the difference of each joint,
    rad, at which two postures share 60 % of it. expected (3,): 1 σ of each axis, mm. All are found by marginal
    likelihood (`fitted_to`), so that nothing scales them again. The part that the centres do not span is not predicted:
    it belongs to the uncertainty (`variance`).
    """

    centres: Floats
    lengths: Floats
    expected: tuple[float, ...]
    bases: tuple[PostureBasis, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if self.lengths.shape != (3, self.centres.shape[1]) or len(self.expected) != 3:
            raise ValueError("a field has three rows of lengths, one of each joint, and three expected sizes")
        if not (self.lengths > 0.0).all():
            raise ValueError("the lengths of a field are above 0")
        object.__setattr__(self, "bases", tuple(PostureBasis(self.centres / own, 1.0) for own in self.lengths))

    group: ClassVar[Group] = "field"
    title: ClassVar[str] = "Field"
    chosen: ClassVar = "by held-out rows"
    prior_scales: ClassVar = None

    @classmethod
    def of_inputs(cls, setup: EffectInputs) -> Self | None:
        """Over the postures of the rows, with the same length for every joint until `fitted_to` sets them."""
        if len(setup.at.q) < ROWS_AT_LEAST:
            return None
        lengths = np.full((3, setup.at.q.shape[1]), LENGTH_RAD.median)
        return cls._over(setup.at.q, lengths, (PRIORS.amplitude.median,) * 3)

    def fitted_to(self, left: Remainder) -> Self | None:
        """With the lengths and sizes of greatest marginal likelihood; None where no axis is more probable with it."""
        if len(left.q) < ROWS_AT_LEAST:
            return None
        axes = [
            AxisProcess.fitted(left.q, errors, PRIORS, known)
            for errors, known in zip(left.errors.T, left.known, strict=True)
        ]
        pairs = zip(axes, left.errors.T, left.known, strict=True)
        gain = sum(axis.gain(left.q, errors, known) for axis, errors, known in pairs)
        if gain < SHOWN * 3 * (left.q.shape[1] + 1):
            return None
        return self._over(left.q, np.stack([axis.lengths for axis in axes]), tuple(axis.amplitude for axis in axes))

    @classmethod
    def _over(cls, q: Floats, lengths: Floats, expected: tuple[float, ...]) -> Self:
        usual = np.exp(np.log(lengths).mean(axis=0))
        return cls(spread(q / usual, CENTRES) * usual, lengths, expected)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Three for each centre, mm."""
        return tuple(
            Parameter(f"field{m + 1}_{axis}", MM, self.group, f"field{m + 1} {axis.upper()}", _PHRASE)
            for m in range(len(self.centres))
            for axis in "xyz"
        )

    @property
    def sigma(self) -> Floats:
        """Prior 1 σ about 0, mm."""
        return np.tile(np.array(self.expected), len(self.centres))

    def suits(self, joints: int) -> bool:
        """Whether its postures are those of so many joints."""
        return bool(self.centres.shape[1] == joints)

    def shifts(self, nominal: SerialChain, at: Postures) -> Floats:
        """Ψ (N, 3, 3M): φ of each centre, on each axis."""
        result = np.zeros((len(at), 3, len(self.centres), 3))
        for axis, (basis, lengths) in enumerate(zip(self.bases, self.lengths, strict=True)):
            result[:, axis, :, axis] = basis.values(at.q / lengths)
        return result.reshape(len(at), 3, 3 * len(self.centres))

    def variance(self, at: Postures) -> Floats:
        """Variance that the centres leave at each posture (N,), mm², mean of the axes: far away all of it."""
        pairs = zip(self.expected, self.bases, self.lengths, strict=True)
        left = [size**2 * basis.remainder(at.q / lengths) for size, basis, lengths in pairs]
        return np.asarray(np.mean(left, axis=0))
