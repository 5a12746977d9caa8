"""Motor currents for a step: from the device that the cell file names, with its scale and offset."""

from __future__ import annotations

from dataclasses import replace
from typing import final

from cellctl.devices import CurrentSource, MotorCurrents
from cellctl.formats.cell_sections import Currents, currents_of
from cellctl.procedure import StepContext


@final
class ScaledCurrents:
    """A source of motor currents with scale and offset of the cell file applied, once."""

    def __init__(self, source: CurrentSource, settings: Currents) -> None:
        self._source, self._settings = source, settings

    async def currents(self, samples: int) -> MotorCurrents:
        """Amperes of A1…An, and their σ; raises as `CurrentSource.currents` does."""
        found = await self._source.currents(samples)
        amperes, sigma_a = self._settings.applied(found.amperes), self._settings.applied_sigma(found.sigma_a)
        return replace(found, amperes=amperes, sigma_a=sigma_a)


def current_source(context: StepContext, axes: int) -> ScaledCurrents | None:
    """The source that `currents:` of the cell file names, for a robot of `axes` axes; None if it names none.

    The step needs `robot` and uses `drives`. Raises InputError for an error in the cell file.
    """
    if "currents" not in context.cell.data:
        return None
    settings = currents_of(context.cell, axes)
    device = context.device("robot") if settings.source == "robot" else context.optional_device("drives")
    return ScaledCurrents(device, settings) if device else None
