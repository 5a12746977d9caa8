"""Effects as a model file holds them: each kind with its settings, so that the robot can be built again."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias, final

from pydantic import BaseModel, ConfigDict, Field

from cellctl.formats.robot import UPRIGHT, Number

if TYPE_CHECKING:
    from cellctl.calibration import Effect

_STRICT = ConfigDict(extra="forbid", strict=True, frozen=True)


Down: TypeAlias = Annotated[tuple[Number, Number, Number], Field(strict=False)]
"""A unit vector; files from before robots could stand otherwise do not have it."""


@final
class DeflectionSettings(BaseModel):
    """Tool deflection: length (m) and load (N) of the taught tool; expected: prior 1 σ, 1/(N m²); down: which way
    weight pulls, in the robot's own base frame.
    """

    model_config = _STRICT
    kind: Literal["deflection"] = "deflection"
    length_m: Number
    load_n: Number
    expected: Number
    down: Down = UPRIGHT

    def effect(self) -> Effect:
        """The effect with these settings."""
        from cellctl.calibration import ToolDeflection

        return ToolDeflection(self.length_m, self.load_n, self.expected, self.down)


@final
class ComplianceSettings(BaseModel):
    """Joint compliance: whether payloads were known; joints (from 1) that carry no weight; down: which way it pulls, in
    the robot's own base frame.
    """

    model_config = _STRICT
    kind: Literal["compliance"] = "compliance"
    joints: int
    load_known: bool
    upright: list[int]
    down: Down = UPRIGHT

    def effect(self) -> Effect:
        """The effect with these settings."""
        from cellctl.calibration import JointCompliance

        return JointCompliance(self.joints, self.load_known, frozenset(self.upright), self.down)


@final
class HarmonicsSettings(BaseModel):
    """Harmonics: waves per turn of every joint; ripple: further waves [joint, waves]; expected: prior 1 σ, rad."""

    model_config = _STRICT
    kind: Literal["harmonics"] = "harmonics"
    joints: int
    orders: list[int]
    ripple: list[Annotated[list[int], Field(min_length=2, max_length=2)]] = []
    expected: Number

    def effect(self) -> Effect:
        """The effect with these settings."""
        from cellctl.calibration import Harmonics

        ripple = tuple((joint, waves) for joint, waves in self.ripple)
        return Harmonics(self.joints, tuple(self.orders), ripple=ripple, expected=self.expected)


@final
class BacklashSettings(BaseModel):
    """Backlash; expected: prior 1 σ, rad."""

    model_config = _STRICT
    kind: Literal["backlash"] = "backlash"
    joints: int
    expected: Number

    def effect(self) -> Effect:
        """The effect with these settings."""
        from cellctl.calibration import Backlash

        return Backlash(self.joints, self.expected)


@final
class GrowthSettings(BaseModel):
    """Growth: links (from 1) without a length; expected: prior 1 σ, 1/K."""

    model_config = _STRICT
    kind: Literal["growth"] = "growth"
    joints: int
    points: list[int]
    expected: Number

    def effect(self) -> Effect:
        """The effect with these settings."""
        from cellctl.calibration import Growth

        return Growth(self.joints, frozenset(self.points), self.expected)


@final
class DiscrepancySettings(BaseModel):
    """Discrepancy: postures that it is expanded at, model angles, rad; its length, rad; expected: prior 1 σ, mm."""

    model_config = _STRICT
    kind: Literal["discrepancy"] = "discrepancy"
    centres: Annotated[list[list[Number]], Field(min_length=1)]
    length: Annotated[float, Field(gt=0.0)]
    expected: Number

    def effect(self) -> Effect:
        """The effect with these settings. Raises ValueError for postures of unequal length."""
        import numpy as np

        from cellctl.calibration import Discrepancy

        return Discrepancy(np.array(self.centres), self.length, self.expected)


EffectSettings: TypeAlias = Annotated[
    DeflectionSettings
    | ComplianceSettings
    | HarmonicsSettings
    | BacklashSettings
    | GrowthSettings
    | DiscrepancySettings,
    Field(discriminator="kind"),
]


def settings_of(effects: Iterable[Effect]) -> list[EffectSettings]:
    """The settings of each effect. Raises TypeError for one that has no form in a file."""
    return [_settings(effect) for effect in effects]


def _settings(effect: Effect) -> EffectSettings:
    from cellctl.calibration import Backlash, Discrepancy, Growth, Harmonics, JointCompliance, ToolDeflection

    match effect:
        case ToolDeflection():
            return DeflectionSettings(
                length_m=effect.length_m, load_n=effect.load_n, expected=effect.expected, down=effect.down
            )
        case JointCompliance():
            upright = sorted(effect.upright)
            return ComplianceSettings(
                joints=effect.joints, load_known=effect.load_known, upright=upright, down=effect.down
            )
        case Harmonics():
            ripple = [list(wave) for wave in effect.ripple]
            orders = list(effect.orders)
            return HarmonicsSettings(joints=effect.joints, orders=orders, ripple=ripple, expected=effect.expected)
        case Backlash():
            return BacklashSettings(joints=effect.joints, expected=effect.expected)
        case Growth():
            return GrowthSettings(joints=effect.joints, points=sorted(effect.points), expected=effect.expected)
        case Discrepancy():
            centres = effect.centres.tolist()
            return DiscrepancySettings(centres=centres, length=effect.length_rad, expected=effect.expected)
        case _:
            raise TypeError(f"{type(effect).__name__} has no form in a model file")
