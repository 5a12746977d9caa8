"""The interface of an error map as a term of a model: learnt from what the other terms leave, after these.

The other effects are linear in amounts that the estimator finds together with the geometry. A map (kriging, a network)
is not: it is fitted to the errors e = actual − model of an identified robot, and then predicts them,

    p(q) = f(q; θ) + R e(q),    R: the base's rotation.

It has no amounts. Its settings are chosen from the same rows, never from those that judge the result.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Self, final

import numpy as np

from cellctl.calibration.model.effect import EffectInputs
from cellctl.calibration.model.parameter import Parameter
from cellctl.calibration.model.postures import Postures
from cellctl.calibration.model.residual_model import ResidualModel
from cellctl.calibration.model.robot_model import RobotModel
from cellctl.kinematics import Floats


@final
@dataclass(frozen=True, eq=False)
class Residuals:
    """What an identified model leaves at N rows.

    model: with all terms but the map. at: the rows' postures and conditions. errors (N, 3): actual − model, mm, of the
    TCP along the axes of the robot's base. stated (N, 3): variance of them that every prediction has besides the
    map's, mm²: of the instrument, and of the model's parameters.
    """

    model: RobotModel
    at: Postures
    errors: Floats
    stated: Floats


class LearntMap(ResidualModel):
    """A term without amounts, learnt from what all others leave. Derived classes are dataclasses, as effects are."""

    __slots__ = ()

    chosen: ClassVar = "named"
    is_map: ClassVar = True
    prior_scales: ClassVar = None

    @classmethod
    @abstractmethod
    def of_options(cls, options: str, joints: int) -> Self:
        """The map to be learnt for a robot of so many joints; options: `key=value,…` of `--model NAME:KEY=VALUE,…`.

        Raises ValueError with the cure for a key or a value that it does not have.
        """

    @abstractmethod
    def learnt(self, residuals: Residuals) -> Self:
        """The same with its content, from these rows alone. Raises ValueError for rows that make no map."""

    @classmethod
    def of_inputs(cls, setup: EffectInputs) -> Self:
        """With its default settings."""
        return cls.of_options("", setup.chain.n)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """None."""
        return ()

    @property
    def sigma(self) -> Floats:
        """None: (0,)."""
        return np.zeros(0)


def learnt_maps(model: RobotModel) -> tuple[LearntMap, ...]:
    """The maps among a model's effects."""
    return tuple(effect for effect in model.effects if isinstance(effect, LearntMap))
