"""Thermal expansion of the links."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Self, final

import numpy as np

from cellctl.calibration.model.effect import Effect, EffectInputs, OnlineTerms
from cellctl.calibration.model.parameter import Group, Parameter, Phrase, Unit
from cellctl.calibration.model.postures import Postures, varies
from cellctl.kinematics import Floats, SerialChain

EXPECTED_PER_K = 2e-5
"""1 σ about 0, 1/K: between steel, 1.2e-5, and aluminium, 2.3e-5. About 0, not about these: the sensor's temperature is
not the link's, and some controllers compensate part of the expansion themselves."""

POINT_MM = 1e-6
"""A link shorter than this is a point: rounding of the frames."""

PER_K = Unit("1/K", "µm/(m·K)", 1e6)
_PHRASE = Phrase.of("growth", "link")


@final
@dataclass(frozen=True)
class ThermalExpansion(Effect):
    """Each link's linear thermal expansion.

    joints: how many. points: links (from 1) of no length, as in a spherical wrist, which have no amount; `of` finds
    them. `growth{i}`, 1/K: of link i, from the origin of the frame behind joint i to that behind joint
    i + 1 (the last: to the flange; the first: from the base's origin, as the pedestal grows with it). All alike, they
    scale the robot about its base's origin. The tool is not counted: it has a temperature of its own.
    needs: rows with known, different temperatures; where `delta_t` is None no link expands.
    """

    joints: int
    points: frozenset[int] = frozenset()
    expected: float = EXPECTED_PER_K

    @classmethod
    def of(cls, nominal: SerialChain) -> Self:
        """The expansion of a robot, without the links that are points; the base of `nominal` does not matter."""
        standing = nominal.with_base(np.eye(4))
        lengths = np.linalg.norm(_link_vectors(standing, np.zeros((1, nominal.n)))[0], axis=-1)
        return cls(nominal.n, frozenset((np.flatnonzero(lengths < POINT_MM) + 1).tolist()))

    group: ClassVar[Group] = "growth"
    title: ClassVar[str] = "Thermal expansion"
    needs: ClassVar[str] = "a column temperature with different values"
    missing: ClassVar = (("delta_t", "no column temperature: predicted for 20 °C"),)

    @classmethod
    def of_inputs(cls, setup: EffectInputs) -> Self | None:
        """The effect, if the temperature changes; else None."""
        return cls.of(setup.chain) if varies(setup.at.delta_t) else None

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """One for each link that has a length, 1/K."""
        return tuple(
            Parameter(f"growth{i}", PER_K, self.group, f"link {i} growth", _PHRASE, str(i), i)
            for i in (each + 1 for each in self._grown)
        )

    @property
    def sigma(self) -> Floats:
        """Prior 1 σ about 0, 1/K."""
        return np.full(len(self._grown), self.expected)

    def shifts(self, nominal: SerialChain, at: Postures) -> Floats:
        """Ψ (N, 3, K): each link's vector, mm, times the temperature difference, K."""
        if at.delta_t is None:
            return np.zeros((len(at), 3, len(self._grown)))
        links = _link_vectors(nominal, at.q)[:, self._grown]
        return np.asarray(np.swapaxes(links * at.delta_t[:, None, None], 1, 2))

    def add_online(self, amounts: Floats, terms: OnlineTerms) -> None:
        """Link i reaches from the frame behind joint i (the first: from the base) to that behind joint i + 1."""
        if terms.at.delta_t is None:
            terms.left_out.append("thermal expansion: no temperature was given, corrected for 20 °C")
            return
        grown = amounts * float(terms.at.delta_t[0])
        for link, amount in zip(self._grown, grown.tolist(), strict=True):
            terms.stretch[link + 1] += amount
            if link:
                terms.stretch[link] -= amount

    @property
    def _grown(self) -> list[int]:
        return [i for i in range(self.joints) if i + 1 not in self.points]


def _link_vectors(nominal: SerialChain, q: Floats) -> Floats:
    """From each link's origin to the next one's (N, n, 3), mm; the first from the base's."""
    return np.diff(nominal.frames(q)[:, 1:, :3, 3], axis=1, prepend=0.0)
