"""An effect: thermal expansion shifts the tool along the flange's axes, in proportion to the temperature."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self, final

import numpy as np

from cellctl.calibration import Effect, EffectInputs, Parameter, Phrase, Postures, Unit, varies
from cellctl.kinematics import Floats, SerialChain

UNIT = Unit("mm/K", "µm/K", 1e3)


@final
@dataclass(frozen=True)
class ToolHeat(Effect):
    """Three amounts, along the flange's x, y, z. expected: how large each is, 1 σ, mm/K; a model file keeps it."""

    expected: float = 0.01

    group: ClassVar[str] = "tool_heat"
    title: ClassVar[str] = "Tool heat"
    needs: ClassVar[str] = "a column temperature with different values"
    missing: ClassVar = (("delta_t", "no column temperature: the tool is taken to be at 20 °C"),)

    @classmethod
    def of_inputs(cls, setup: EffectInputs) -> Self | None:
        """See `Effect`: the rows support it where their temperatures differ."""
        return cls() if varies(setup.at.delta_t) else None

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Its amounts."""
        phrase = Phrase("tool heat along {}", "tool heat along {}")
        return tuple(
            Parameter(f"tool_heat_{axis}", UNIT, self.group, f"tool heat {axis.upper()}", phrase, axis.upper())
            for axis in "xyz"
        )

    @property
    def sigma(self) -> Floats:
        """The prior of each amount (3,), 1 σ, mm/K."""
        return np.full(3, self.expected)

    def shifts(self, nominal: SerialChain, at: Postures) -> Floats:
        """Ψ (N, 3, 3): K times the flange's axes in the base frame."""
        delta_t = np.zeros(len(at)) if at.delta_t is None else at.delta_t
        return np.asarray(nominal.forward_flange(at.q)[:, :3, :3] * delta_t[:, None, None])
