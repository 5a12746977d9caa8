"""Non-geometric effects of a robot: they turn its joints, or shift its TCP, in proportion to amounts."""

from collections.abc import Iterable

from cellctl.calibration.effects._backlash import Backlash
from cellctl.calibration.effects._compliance import JointCompliance
from cellctl.calibration.effects._deflection import DEFLECTION, ToolDeflection
from cellctl.calibration.effects._prismatic import JointScale, Straightness
from cellctl.calibration.effects._thermal_expansion import ThermalExpansion
from cellctl.calibration.effects.motor_torsion import MotorTorsion
from cellctl.calibration.model.effect import (
    DOWN,
    STANDARD_GRAVITY,
    Direction,
    Effect,
    EffectInputs,
    OnlineTerms,
    OwnTurns,
)
from cellctl.calibration.model.parameter import Group
from cellctl.calibration.model.residual_model import ResidualModel
from cellctl.calibration.residuals.discrepancy import Discrepancy
from cellctl.calibration.residuals.harmonics import Harmonics, Wave
from cellctl.calibration.residuals.joint_field import JointField

EFFECTS: tuple[type[Effect], ...] = (
    JointScale,
    Straightness,
    ToolDeflection,
    JointCompliance,
    MotorTorsion,
    Harmonics,
    Backlash,
    ThermalExpansion,
    JointField,
    Discrepancy,
)
"""All kinds of effects, in the order in which a model's name lists them."""


_ADDED: list[type[Effect]] = []


def add_kind(kind: type[Effect]) -> None:
    """Add the effect of another package, behind `EFFECTS`. Calibration reads no entry points: `cellctl.formats` calls
    this once for each. Raises ValueError if there is an effect of that group.
    """
    if kind.group in kinds():
        raise ValueError(f"there is an effect '{kind.group}' already")
    _ADDED.append(kind)


def kinds() -> dict[Group, type[Effect]]:
    """The kind of effect of each group, in the order of `EFFECTS`, then those of other packages."""
    return {kind.group: kind for kind in (*EFFECTS, *_ADDED)}


def functions() -> frozenset[Group]:
    """Groups whose amounts are the coefficients of a random function, not parameters on their own."""
    return frozenset(group for group, kind in kinds().items() if issubclass(kind, ResidualModel) and not kind.is_map)


def in_order(effects: Iterable[Effect]) -> tuple[Effect, ...]:
    """The effects in the order of `kinds`."""
    order = list(kinds())
    return tuple(sorted(effects, key=lambda effect: order.index(effect.group)))


__all__ = [
    "DEFLECTION",
    "DOWN",
    "EFFECTS",
    "STANDARD_GRAVITY",
    "Backlash",
    "Direction",
    "Discrepancy",
    "Effect",
    "EffectInputs",
    "Harmonics",
    "JointCompliance",
    "JointField",
    "JointScale",
    "MotorTorsion",
    "OnlineTerms",
    "OwnTurns",
    "ResidualModel",
    "Straightness",
    "ThermalExpansion",
    "ToolDeflection",
    "Wave",
    "add_kind",
    "functions",
    "in_order",
    "kinds",
]
