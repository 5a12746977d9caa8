"""The tool as a cantilever: how far its tip sinks by its own weight and a payload's."""

from __future__ import annotations

from typing import final

from sims.conditions import Payload
from sims.world.statics import GRAVITY_M_S2

TOOL_COMPLIANCE = 0.00036
"""c_t = 1/(E·I) of the torch, 1/(N·m²); Wang et al. 2024, identified."""


@final
class Bending:
    """Of a tool of this length along the flange's z (mm) and mass at its end (kg). `scale`: of the error."""

    def __init__(self, length_mm: float, mass_kg: float, scale: float) -> None:
        self._length_mm, self._scale = length_mm, scale
        self._own_mm = scale * _end_sag_mm(length_mm, mass_kg)

    def sag_mm(self, payload: Payload) -> float:
        """How far the tip sinks held level. A payload without a centre of gravity does not bend the tool."""
        if payload.at is None:
            return self._own_mm
        return self._own_mm + self._scale * sag_mm(self._length_mm, payload.at[2], payload.kg)


def sag_mm(length_mm: float, at_mm: float, mass_kg: float) -> float:
    """How far the tip of a level tool sinks by a mass at another place along it.

    A place beyond the tip is on a stiff extension of the tool; one behind the flange bends nothing.
    """
    near, far = sorted((max(length_mm, 0.0) * 1e-3, max(at_mm, 0.0) * 1e-3))
    return TOOL_COMPLIANCE * near**2 * (3.0 * far - near) / 6.0 * mass_kg * GRAVITY_M_S2 * 1e3


def _end_sag_mm(length_mm: float, mass_kg: float) -> float:
    """c_t · l³/3 · G, by a mass at the tip."""
    return TOOL_COMPLIANCE * (length_mm * 1e-3) ** 3 / 3.0 * mass_kg * GRAVITY_M_S2 * 1e3
