"""What the robot does at given joints: an identified robot, or the nominal one with predicted position errors.

f is the controller's nominal kinematics, f* the identified robot, f₂ the identified robot without its errors of joint
zeros Δθ: f₂(q) = f*(q − Δθ).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, Self, TypeAlias, final

import numpy as np

from cellctl.calibration import RobotModel
from cellctl.error_maps import ErrorMap
from cellctl.kinematics import Floats, SerialChain

PredictedErrors: TypeAlias = Callable[[Floats], Floats]
"""Errors of the TCP (N, 3), mm, actual − nominal, at model angles (N, n), rad: an error map's `errors`."""


@final
@dataclass(frozen=True, eq=False)
class MappedErrors:
    """`PredictedErrors` of an error map, with its own σ where it states one: the model's is not theirs."""

    of: ErrorMap

    def __call__(self, q: Floats) -> Floats:
        """The map's errors (N, 3), mm."""
        return self.of.errors(q)

    def sigma(self, q: Floats) -> Floats | None:
        """1 σ (N,), 3-D, mm; None: the map states none."""
        stated = getattr(self.of, "sigma", None)
        return np.asarray(np.linalg.norm(stated(q), axis=-1)) if callable(stated) else None


class Predictor(Protocol):
    """A robot, as the corrections need it."""

    @property
    def zeros(self) -> Floats:
        """Subtracted from the joints (n,), rad, to command them."""

    def pose(self, q: Floats) -> Floats:
        """TCP (N, 4, 4), mm, at joints q (N, n), rad."""

    def jacobian(self, q: Floats) -> Floats:
        """Of the TCP by the joints (N, 6, n), mm and rad per rad."""


@final
@dataclass(frozen=True, eq=False)
class WithoutZeros:
    """f₂ of an identified robot: `zeros` (n,), rad, are the errors of joint zeros that are left out of it."""

    identified: RobotModel
    zeros: Floats

    @classmethod
    def of(cls, identified: RobotModel, *, apart: bool) -> Self:
        """apart: θ1 … θn are left out (a joint without that parameter has none); otherwise nothing is."""
        amounts = [identified.amount(f"theta{joint}") or 0.0 for joint in range(1, identified.n + 1)]
        return cls(identified, np.array(amounts) if apart else np.zeros(identified.n))

    def pose(self, q: Floats) -> Floats:
        """TCP (N, 4, 4), mm, at joints q (N, n), rad."""
        return self.identified.pose(q - self.zeros)

    def jacobian(self, q: Floats) -> Floats:
        """Of the TCP by the joints (N, 6, n), mm and rad per rad."""
        return self.identified.chain.tool_jacobian(q - self.zeros)


@final
@dataclass(frozen=True, eq=False)
class NominalWithErrors:
    """f(q) + ê(q): the nominal robot, its TCP shifted by predicted errors; they do not turn it."""

    nominal: SerialChain
    errors: PredictedErrors

    @property
    def zeros(self) -> Floats:
        """None are known: 0 (n,)."""
        return np.zeros(self.nominal.n)

    def pose(self, q: Floats) -> Floats:
        """TCP (N, 4, 4), mm, at joints q (N, n), rad."""
        poses = self.nominal.forward(q)
        poses[:, :3, 3] += self.errors(q)
        return poses

    def jacobian(self, q: Floats) -> Floats:
        """Of the nominal TCP by the joints (N, 6, n), mm and rad per rad."""
        return self.nominal.tool_jacobian(q)
