"""Play in the gears: the position at which a joint stops depends on its direction of approach."""

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
from cellctl.calibration.model.parameter import MM, RAD, Group, Parameter, Phrase
from cellctl.calibration.model.postures import Postures
from cellctl.kinematics import MM_PER_M, Floats, SerialChain

EXPECTED_RAD = 1.5e-4
"""Half of one minute of arc, the most that makers of robot gears promise as backlash or lost motion."""

EXPECTED_MM = 0.1
"""Half the play of a rack and pinion, 0.1 to 0.3 mm where it is not preloaded."""

_PHRASE = Phrase.of("backlash", "joint")


@final
@dataclass(frozen=True)
class Backlash(Effect):
    """Half the play of each joint, along the way it last moved.

    joints: how many. prismatic: those, from 1, that are. `backlash{j}`, rad, or mm: how far the joint is ahead
    of its reading, along its last move.
    Negative: the joint lags behind (a gear's play, with the encoder on the motor); the play is twice the size.
    needs: rows with known approach, from both sides; where it is unknown (None, or 0), the joint is taken midway.
    """

    joints: int
    expected: float = EXPECTED_RAD
    prismatic: frozenset[int] = prismatic_field()

    group: ClassVar[Group] = "backlash"
    title: ClassVar[str] = "Backlash"
    needs: ClassVar[str] = "columns D1…Dn, with 1 and -1 for at least one joint, say from which side each joint came"
    missing: ClassVar = (("approach", "no columns D1…Dn: predicted midway in each joint's play"),)

    @classmethod
    def of_inputs(cls, setup: EffectInputs) -> Self | None:
        """The effect, if any joint was approached from both sides; else None."""
        sides = setup.at.approach
        both = sides is not None and ((sides > 0).any(axis=0) & (sides < 0).any(axis=0)).any()
        return cls(setup.chain.n, prismatic=prismatic_joints(setup.chain)) if both else None

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """One for each joint, rad or mm."""
        return tuple(
            Parameter(
                f"backlash{j}", MM if j in self.prismatic else RAD, self.group, f"A{j} half play", _PHRASE, str(j), j
            )
            for j in range(1, self.joints + 1)
        )

    @property
    def sigma(self) -> Floats:
        """Prior 1 σ about 0, rad or mm."""
        return np.array([EXPECTED_MM if j in self.prismatic else self.expected for j in range(1, self.joints + 1)])

    def turns(self, nominal: SerialChain, at: Postures) -> Floats:
        """Φ (N, n, n): each joint's approach in its own row."""
        approach = np.zeros(at.q.shape) if at.approach is None else at.approach
        m_per_mm = [1.0 / MM_PER_M if j in self.prismatic else 1.0 for j in range(1, self.joints + 1)]
        return np.asarray(approach[:, :, None] * np.diag(m_per_mm))

    def add_online(self, amounts: Floats, terms: OnlineTerms) -> None:
        """Nothing: a telegram does not tell what it depends on."""
        words = "backlash: each joint is taken midway in its play, as its direction of motion changes on the way"
        terms.left_out.append(words)
