"""Play in the gears: where a joint comes to rest depends on where it came from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from cellctl.calibration.model.postures import Postures
from cellctl.kinematics import Floats, SerialChain

EXPECTED_RAD = 1.5e-4
"""Half of one minute of arc, the most that makers of robot gears promise as backlash or lost motion."""


@final
@dataclass(frozen=True, slots=True)
class Backlash:
    """Half the play of each joint, along the way it last moved.

    joints: how many. `backlash{j}`, rad: by how much the joint stands further along its last move than it reads.
    Negative where it lags behind (a gear's play, with the encoder on the motor); the play is twice the size.
    needs: rows whose approach is known, from both sides; where it is not known (None, or 0), the joint stands midway.
    """

    joints: int
    expected: float = EXPECTED_RAD

    @property
    def group(self) -> str:
        """`backlash`."""
        return "backlash"

    @property
    def parameters(self) -> tuple[str, ...]:
        """One for each joint."""
        return tuple(f"backlash{j + 1}" for j in range(self.joints))

    @property
    def units(self) -> tuple[str, ...]:
        """Rad."""
        return ("rad",) * self.joints

    @property
    def sigma(self) -> Floats:
        """Prior 1 σ about 0, rad."""
        return np.full(self.joints, self.expected)

    @property
    def least(self) -> Floats:
        """−inf: a joint leads or lags."""
        return np.full(self.joints, -np.inf)

    def turns(self, nominal: SerialChain, at: Postures) -> Floats:
        """Φ (N, n, n): each joint's approach in its own row."""
        approach = np.zeros(at.q.shape) if at.approach is None else at.approach
        return np.asarray(approach[:, :, None] * np.eye(self.joints))

    def shifts(self, nominal: SerialChain, at: Postures) -> None:
        """None: joints turn, and carry the tool with them."""
