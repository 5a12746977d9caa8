"""The tool bends under its own weight."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Self, final

import numpy as np

from cellctl.calibration.model.effect import DOWN, STANDARD_GRAVITY, Direction, Effect, EffectInputs, OnlineTerms
from cellctl.calibration.model.parameter import Group, Parameter, Phrase, Unit
from cellctl.calibration.model.postures import Postures
from cellctl.kinematics import Floats, SerialChain

DEFLECTION = "tool_deflection"
"""Name of the tool's bending amount c_t, 1/(N m^2)."""

PER_NM2 = Unit("1/(N m^2)", "1/(N·m²)")
_PHRASE = Phrase("tool deflection", "tool deflection")


@final
@dataclass(frozen=True)
class ToolDeflection(Effect):
    """The tool as a cantilever along the flange's z with its weight at the end.

    length_m: from the flange to the TCP, along z (of the taught tool: c_t absorbs an error in it).
    load_n: weight at the end, N. expected: prior 1 σ of c_t = 1/(E·I) about 0, 1/(N m^2); 0.002 is what Wang et al.
    simulate (0.00036 is what they identify). down: ĝ in the robot's base frame.
    TCP shift c_t · l³/3 · G · (ĝ − (ĝ·z)z), after Wang et al. 2024 (doi 10.3390/app14219824), eq. 11–20. The tilt at
    the end is part of that shift already, and is not added to it again as their eq. 21 would. No orientation changes:
    the tilt (arc minutes) is left out. A payload whose centre of gravity is known bends the same cantilever where it is
    along z. needs: the tool's mass.
    """

    length_m: float
    load_n: float
    expected: float = 0.002
    down: Direction = DOWN

    group: ClassVar[Group] = "deflection"
    title: ClassVar[str] = "Tool deflection"
    chosen: ClassVar = "named"
    of_touches: ClassVar[bool] = True
    needs: ClassVar[str] = "the robot file's tool needs a mass, and a length along z"
    prior_scales: ClassVar = None

    @classmethod
    def of_inputs(cls, setup: EffectInputs) -> Self | None:
        """The effect, if the tool has a mass and a length along z."""
        length_m, load_n = float(setup.chain.tool[2, 3]) / 1000.0, setup.tool_mass_kg * STANDARD_GRAVITY
        return cls(length_m, load_n, down=setup.down) if length_m > 0.0 < load_n else None

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """`tool_deflection` alone, 1/(N m^2)."""
        return (Parameter(DEFLECTION, PER_NM2, self.group, "tool deflection c_t", _PHRASE),)

    @property
    def sigma(self) -> Floats:
        """Prior 1 σ of c_t (1,)."""
        return np.array([self.expected])

    @property
    def least(self) -> Floats:
        """0: no tool bends upwards under its weight."""
        return np.zeros(1)

    @property
    def mm_per_unit(self) -> float:
        """Shift of a horizontal tool's TCP for c_t = 1, mm."""
        return 1000.0 * self.length_m**3 / 3.0 * self.load_n

    def shifts(self, nominal: SerialChain, at: Postures) -> Floats:
        """Ψ (N, 3, 1): the part of ĝ across the flange's z, times `mm_per_unit`."""
        axis = nominal.forward_flange(at.q)[..., :3, 2]
        across = self.down - (axis @ self.down)[..., None] * axis
        return np.asarray((self.mm_per_unit + self.mm_by_payload(at)) * across)[..., None]

    def add_online(self, amounts: Floats, terms: OnlineTerms) -> None:
        """Its bending at this load."""
        terms.down = self.down
        terms.bend += float(amounts[0]) * float(np.ravel(self.mm_per_unit + self.mm_by_payload(terms.at))[0])

    def mm_by_payload(self, at: Postures) -> Floats | float:
        """What a payload adds to `mm_per_unit` (N, 1): the tip's shift by a weight at another place of a cantilever.

        Deflection at x by a weight at a ≤ x: a² (3x − a)/6EI; the same with x and a exchanged (Maxwell).
        """
        if at.payload is None or at.payload_at is None:
            return 0.0
        place_m = np.maximum(at.payload_at[:, 2], 0.0) / 1000.0
        near, far = np.minimum(place_m, self.length_m), np.maximum(place_m, self.length_m)
        bending = 1000.0 * near**2 * (3.0 * far - near) / 6.0 * STANDARD_GRAVITY * at.payload
        return np.asarray(bending[:, None])
