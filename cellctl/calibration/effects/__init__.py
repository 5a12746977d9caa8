"""What a robot does besides its geometry: effects that turn its joints, or shift its tool, in proportion to amounts."""

from collections.abc import Iterable

from cellctl.calibration.effects.backlash import Backlash
from cellctl.calibration.effects.compliance import JointCompliance
from cellctl.calibration.effects.deflection import DEFLECTION, ToolDeflection
from cellctl.calibration.effects.discrepancy import Discrepancy
from cellctl.calibration.effects.effect import Effect, OwnTurns
from cellctl.calibration.effects.gravity import DOWN, STANDARD_GRAVITY, Direction
from cellctl.calibration.effects.growth import Growth
from cellctl.calibration.effects.harmonics import Harmonics, Wave

EFFECTS = ("deflection", "compliance", "harmonics", "backlash", "growth", "discrepancy")
"""Groups of all effects, in the order in which a model's name lists them."""


def in_order(effects: Iterable[Effect]) -> tuple[Effect, ...]:
    """The effects in the order of `EFFECTS`."""
    return tuple(sorted(effects, key=lambda effect: EFFECTS.index(effect.group)))


__all__ = [
    "DEFLECTION",
    "DOWN",
    "EFFECTS",
    "STANDARD_GRAVITY",
    "Backlash",
    "Direction",
    "Discrepancy",
    "Effect",
    "Growth",
    "Harmonics",
    "JointCompliance",
    "OwnTurns",
    "ToolDeflection",
    "Wave",
    "in_order",
]
