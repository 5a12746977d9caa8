"""Joints lag behind their motors in proportion to the motor current."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Self, final

import numpy as np

from cellctl.calibration.model.effect import (
    Effect,
    EffectInputs,
    OnlineTerms,
    prismatic_field,
    prismatic_joints,
)
from cellctl.calibration.model.parameter import Group, Parameter, Phrase, Unit
from cellctl.calibration.model.postures import Postures
from cellctl.kinematics import Floats, SerialChain

EXPECTED_RAD_PER_A = 2e-4
"""1 σ of a joint's flexibility, rad/A; an estimate.

A joint of an arm with 5 to 20 kg payload turns by 0.3 (weight of its links) to 1 mrad (greatest load), and its motor
holds that with some 3 A: 1e-4 … 3e-4.
"""

VARIES_A = 1e-3
"""A current with a smaller range never changes: a controller's last digit."""

PER_A = Unit("rad/A", "µrad/A", 1e6)
_PHRASE = Phrase.of("flexibility by motor current", "joint")


@final
@dataclass(frozen=True)
class MotorTorsion(Effect):
    """The reducer of each joint as a torsion spring between its motor and its link: Δθ = −F·I.

    joints: how many. prismatic: those, from 1, that are: they have no amount. `flexibility{j}`, rad/A: how far joint j
    lags behind its reading, per ampere in the direction of the joint. A spring is positive; a negative amount of many σ
    shows that a drive counts its current the other way
    (scale −1 in the cell file's `currents`).
    The motor's torque includes friction, so the joint turns by friction too, where the current has it. Source:
    ANN-based precision compensation via optimization of point selection, section 2.2 (Δθ = F·I, F diagonal); the sign
    here: F > 0 for a spring, as current and load turn the joint opposite ways.
    needs: the current of every joint in every row. Where it is unknown (None or NaN), joints do not lag. `auto` does
    not try it: a target of a table has no current.
    """

    joints: int
    expected: float = EXPECTED_RAD_PER_A
    prismatic: frozenset[int] = prismatic_field()

    group: ClassVar[Group] = "motor"
    title: ClassVar[str] = "Flexibility by motor current"
    chosen: ClassVar = "named"
    needs: ClassVar[str] = "columns I1…In with a number in every row, and different values for at least one joint"

    @classmethod
    def of_inputs(cls, setup: EffectInputs) -> Self | None:
        """The effect, if every row has its currents, and any of them changes; else None."""
        currents = setup.at.currents
        if currents is None or not len(currents) or not np.isfinite(currents).all():
            return None
        varies = np.ptp(currents, axis=0).max() > VARIES_A
        return cls(setup.chain.n, prismatic=prismatic_joints(setup.chain)) if varies else None

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """One for each revolute joint, rad/A."""
        return tuple(
            Parameter(f"flexibility{j}", PER_A, self.group, f"A{j} flexibility", _PHRASE, str(j), j)
            for j in self._revolute
        )

    @property
    def _revolute(self) -> list[int]:
        return [j for j in range(1, self.joints + 1) if j not in self.prismatic]

    @property
    def sigma(self) -> Floats:
        """Prior 1 σ about 0, rad/A."""
        return np.full(len(self._revolute), self.expected)

    def lacks(self, at: Postures) -> list[str]:
        """Rows without currents."""
        without = len(at) if at.currents is None else int(np.count_nonzero(np.isnan(at.currents).any(axis=1)))
        words = f"{without} of {len(at)} rows without I1…I{self.joints}"
        return [f"{words}: predicted without flexibility by motor current"] if without else []

    def turns(self, nominal: SerialChain, at: Postures) -> Floats:
        """Φ (N, n, K): minus each joint's current in its own row."""
        currents = np.zeros(at.q.shape) if at.currents is None else np.nan_to_num(at.currents)
        return np.asarray(-currents[:, :, None] * np.eye(self.joints)[:, np.array(self._revolute, int) - 1])

    def add_online(self, amounts: Floats, terms: OnlineTerms) -> None:
        """Nothing: a telegram does not tell what it depends on."""
        terms.left_out.append("flexibility by motor current: on-line correction has no currents")
