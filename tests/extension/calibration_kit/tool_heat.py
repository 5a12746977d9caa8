"""An effect of another package: the tool's shift with temperature."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from cellctl.calibration import Effect, Parameter, Unit
from cellctl.calibration.model.parameter import Phrase
from cellctl.calibration.model.postures import varies

NOTHING = dict


@dataclass(frozen=True)
class ToolInTheHeat(Effect):
    """Along the flange's axes, mm/K."""

    expected: float = 0.01

    group: ClassVar = "tool_heat"
    title: ClassVar = "Tool in the heat"
    needs: ClassVar = "a column temperature with different values"
    missing: ClassVar = (("delta_t", "no column temperature: the tool is taken to be at 20 °C"),)

    @classmethod
    def of_inputs(cls, setup):
        return cls() if varies(setup.at.delta_t) else None

    @property
    def parameters(self):
        unit, phrase = Unit("mm/K", "µm/K", 1e3), Phrase("heat of the tool along {}", "heat of the tool along {}")
        return tuple(
            Parameter(f"tool_heat_{axis}", unit, self.group, f"tool heat {axis.upper()}", phrase, axis.upper())
            for axis in "xyz"
        )

    @property
    def sigma(self):
        return np.full(3, self.expected)

    def shifts(self, nominal, at):
        delta_t = np.zeros(len(at)) if at.delta_t is None else at.delta_t
        return nominal.forward_flange(at.q)[:, :3, :3] * delta_t[:, None, None]
