"""Links grow with temperature."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from cellctl.calibration.postures import Postures
from cellctl.kinematics import Floats, SerialChain

EXPECTED_PER_K = 2e-5
"""Between steel, 1.2e-5, and aluminium, 2.3e-5."""


@final
@dataclass(frozen=True, slots=True)
class Growth:
    """Each link's linear growth with temperature.

    joints: how many. `growth{i}`, 1/K: of link i, from the origin of the frame behind joint i to that behind joint
    i + 1 (the last: to the flange; the first: from the base's origin, as the pedestal grows with it). All alike, they
    scale the robot about its base's origin. The tool is not counted: it has a temperature of its own.
    needs: rows whose temperature is known, and differs; where `warmer` is None nothing grows.
    """

    joints: int
    expected: float = EXPECTED_PER_K

    @property
    def group(self) -> str:
        """`growth`."""
        return "growth"

    @property
    def parameters(self) -> tuple[str, ...]:
        """One for each link."""
        return tuple(f"growth{i + 1}" for i in range(self.joints))

    @property
    def units(self) -> tuple[str, ...]:
        """1/K."""
        return ("1/K",) * self.joints

    @property
    def sigma(self) -> Floats:
        """Prior 1 σ about 0, 1/K."""
        return np.full(self.joints, self.expected)

    def turns(self, nominal: SerialChain, at: Postures) -> None:
        """None: lengths grow, joints stay."""

    def shifts(self, nominal: SerialChain, at: Postures) -> Floats:
        """Ψ (N, 3, n): each link's vector, mm, times how much warmer it is, K."""
        if at.warmer is None:
            return np.zeros((len(at), 3, self.joints))
        ends = nominal.frames(at.q)[:, 1:, :3, 3]
        links = np.diff(ends, axis=1, prepend=0.0)
        return np.asarray(np.swapaxes(links * at.warmer[:, None, None], 1, 2))
